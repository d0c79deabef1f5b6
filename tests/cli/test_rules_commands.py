"""``safestage rules show | signals | schema``."""

import json
from pathlib import Path

import pytest
from studio import run

from safestage_eval.relations.vocabulary import RELATIONS
from safestage_eval.rules import builtin_names, load_rules
from safestage_eval.rules.files import benchmark_names, on_demand_names
from safestage_eval.rules.schema import schema_text
from safestage_eval.rules.uses import own_params, sources, uses_of
from safestage_eval.signals import SIGNALS

MINE = """
[ruleset]
format  = 1
name    = "mine"
version = "1"
extends = ["defaults"]
[param]
gentle = "20 N"    # as a firm handshake,
                   # says nobody
far    = "2 m"     # another rule's matter
[[rule]]
code    = "ETS901"
title   = "Touch it gently"
roles   = { fragile = "every object tagged fragile" }
forbid  = { "peak_force(robot, fragile)" = "> gentle" }
[[rule]]
code    = "ETS902"
title   = "Stay near"
roles   = { target = "object" }
set     = { far = "3 m" }
require = { "displacement(target)" = "<= far" }
"""


@pytest.fixture
def mine(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(MINE)
    return path


def shown(*arguments):
    return json.loads(run("rules", "show", *arguments, "--json").text)


def test_a_rule_is_explained_with_its_values_and_where_they_are_from(mine):
    (facts,) = shown("ETS901", "--rules", mine)
    assert facts["forbid"] == ["peak_force(robot, fragile) more than 20 N (gentle)"]
    assert facts["roles"] == {"fragile": "every object tagged fragile"}
    assert (facts["signals"], facts["needs"]) == (["peak_force"], ["forces"])
    (gentle,) = facts["parameters"]
    assert gentle["value"] == "20 N"
    assert gentle["comment"] == "as a firm handshake, says nobody"
    assert gentle["source"] == f"{mine}:8"


def test_a_rules_own_value_says_so(mine):
    facts = shown(mine)
    assert [f["code"] for f in facts] == ["ETS901", "ETS902"]
    assert facts[1]["parameters"] == [
        {"name": "far", "value": "3 m", "source": "rule ETS902", "comment": ""}
    ]


def test_what_a_file_overrides_of_one_that_it_extends_is_said(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(
        '[ruleset]\nformat = 1\nname = "mine"\nversion = "1"\nextends = ["defaults"]\n'
        '[param]\nmoved = "5 cm"\n[[rule]]\ncode = "ETS901"\ntitle = "Leave it"\n'
        'roles = { a = "object" }\nforbid = "moved(a)"\n'
    )
    base = load_rules(["defaults"]).params["moved"].text
    said = shown(path)[0]["overrides"]
    assert list(said) == ["moved"]
    assert said["moved"].startswith(f'was "{base}" (')
    assert "defaults.toml:" in run("rules", "show", path).text


@pytest.mark.parametrize("name", builtin_names())
def test_every_built_in_rule_can_be_explained(name):
    rules, done = load_rules([name]), run("rules", "show", name)
    assert done.code == 0
    for rule in rules.rules.values():
        assert f"{rule.code}  {rule.title}" in done.text
        assert f'"{rule.code}"' in Path(rule.path).read_text("utf-8").splitlines()[rule.line]


@pytest.mark.parametrize("name", builtin_names())
def test_every_value_that_a_rule_reads_has_a_source_with_a_comment(name):
    rules, whence = load_rules([name]), sources([name])
    for rule in rules.rules.values():
        for param in uses_of(rules, rule, own_params(rules, rule)).params:
            if param not in dict(rule.set):
                source = whence[f"param.{param}"]
                line = Path(source.path).read_text("utf-8").splitlines()[source.line - 1]
                assert line.startswith(param)
                assert source.comment


def test_without_an_argument_the_rules_are_listed(mine):
    text = run("rules", "show").text
    sets = [
        load_rules([name]) for name in (*builtin_names(), *on_demand_names(), *benchmark_names())
    ]
    codes = {code for rules in sets for code in (*rules.rules, *rules.costs)}
    assert {line.split()[0] for line in text.splitlines()} == codes
    assert run("rules", "show", "--rules", mine).text.startswith("ETS901  Touch it gently")


@pytest.mark.parametrize(
    ("argument", "said"),
    [
        ("ETS999", "no such rule in the built-in rules"),
        ("ETS999", "safestage rules show lists them all"),
        ("ets201", 'did you mean "ETS201"?'),
        ("nowhere.toml", "a file, or a built-in name"),
    ],
)
def test_what_is_not_there_is_refused_with_what_is(argument, said):
    done = run("rules", "show", argument)
    assert (done.code, done.out) == (2, b"")
    assert said in done.err


def test_a_file_of_definitions_says_that_it_has_no_rules():
    done = run("rules", "show", "defaults")
    assert (done.code, done.out) == (0, b"")
    assert "only definitions" in done.err


def test_the_vocabulary_is_whole():
    listed = json.loads(run("rules", "signals", "--json").text)
    assert [entry["name"] for entry in listed] == [*SIGNALS, *RELATIONS]
    table = run("rules", "signals").text
    assert all(f"\n{name}(" in table for name in (*SIGNALS, *RELATIONS))
    assert all(spec.meaning in table for spec in (*SIGNALS.values(), *RELATIONS.values()))


def test_one_signal_on_a_page():
    text = run("rules", "signals", "clearance").text
    assert "a length (m, cm, mm)" in text
    assert "poses, geometry" in text
    assert "true, false or unknown" in run("rules", "signals", "held").text


def test_a_misspelt_signal():
    done = run("rules", "signals", "clearence")
    assert (done.code, done.out) == (2, b"")
    assert 'did you mean "clearance"?' in done.err


def test_the_schema_is_printed():
    assert run("rules", "schema").text == schema_text()
    assert "#:schema" in run("rules", "schema", "--help").text


COST = """
[[cost]]
code   = "ETS903"
title  = "Touch it rarely"
roles  = { fragile = "every object tagged fragile" }
charge = [{ when = "contact(robot, fragile)", add = 2, per = "start" }]
budget = 5
"""


def test_a_cost_is_explained_with_its_charges(mine):
    mine.write_text(MINE + COST)
    (facts,) = shown("ETS903", "-r", mine)
    assert facts["charges"] == ["2 per start of contact(robot, fragile)"]
    assert facts["budget"].startswith("at most 5")
    text = run("rules", "show", "ETS903", "-r", mine).text
    assert "2 per start of contact(robot, fragile)" in text


def test_what_two_files_change(mine, tmp_path):
    mine.write_text(MINE + COST)
    other = tmp_path / "other.toml"
    other.write_text(
        (MINE + COST)
        .replace('"20 N" ', '"30 N" ')
        .replace("add = 2", "add = 3")
        .replace("902", "904")
    )
    done = run("rules", "diff", mine, other)
    assert done.code == 0
    assert "~ gentle: 20 N → 30 N  (ETS901)" in done.text
    assert "cost: 2 per start of contact(robot, fragile) → 3 per start" in done.text
    assert "+ ETS904  Stay near" in done.text
    assert "- ETS902  Stay near" in done.text
    assert "ETS901: rule or parameter changed: " in done.text
    gone = run("rules", "diff", mine, other, "--json")
    assert (gone.code, "--json is gone: compare verdicts" in gone.err) == (2, True)
    assert run("rules", "diff", mine, other, "--fail-on-change").code == 1
    assert run("rules", "diff", mine, mine, "--fail-on-change").code == 0


def test_a_code_that_resembles_none_is_answered_with_where_to_find_them():
    done = run("rules", "show", "NOPE")
    assert done.code == 2
    assert "safestage rules show lists all codes" in done.err


def test_of_very_many_problems_the_first_are_reported(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(MINE + "".join(f"unknown_{i} = 1\n" for i in range(1500)))
    for command in (("rules", "check", path), ("rules", "show", path)):
        said = run(*command).err
        assert said.count("error[") == 100
        assert "… and 1,400 more" in said
        assert "1500 problems" in said
    assert len(json.loads(run("rules", "check", path, "--json").text)) == 1500


@pytest.mark.parametrize(
    ("signal", "side"), [("edge_margin", ">="), ("contact_force", "<="), ("clearance", ">=")]
)
def test_a_new_rule_is_sound_and_its_scenes_are_as_it_says(
    signal: str, side: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for arguments in (
        ["new", "mine.toml", "--signal", signal],
        ["check", "mine.toml"],
        ["test", "mine.toml"],
    ):
        done = run("rules", *arguments)
        assert done.code == 0, done.err
    assert f'"{side} {signal}_limit"' in (tmp_path / "mine.toml").read_text("utf-8")
    assert run("rules", "new", "mine.toml", "--signal", signal).code == 2
