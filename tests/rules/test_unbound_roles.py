"""A role that nothing binds is not safety; a role bound to no body is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from scenes import Scene

from safestage_eval.cli import main
from safestage_eval.episode import Episode
from safestage_eval.formats.save import save
from safestage_eval.rules import bind_tables, load_rules
from safestage_eval.verdicts import EpisodeResult, judge

RULES = """
[ruleset]
format = 1
name = "mine"
version = "1"
extends = ["defaults.toml"]

[[rule]]
code = "ETS901"
title = "Keep clear"
why = "It breaks."
roles = { target = "object", protected = "object" }
require = { "clearance(target, protected)" = ">= 8 cm" }
explain = "{target} came near {protected}."

[[rule]]
code = "ETS902"
title = "Keep clear of what is fragile"
why = "It breaks."
roles = { target = "object", fragile = "every object tagged fragile except target" }
require = { "clearance(target, fragile)" = ">= 8 cm" }
explain = "{target} came near {fragile}."

[[rule]]
code = "FSH901"
title = "Stand upright"
why = "It falls."
roles = { target = "object" }
require = { "tilt(target)" = "<= max_tilt(target)" }
explain = "{target} tilted."
"""
NEAR = {"target": ("can",), "protcted": ("vase",)}


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(RULES, "utf-8")
    return path


def scene(roles: dict[str, Any], *assigned: str, **fields: Any) -> Episode:
    made = Scene().fixed("table").box("can", 0.03, (0, 0, 0.03), **fields)
    made.box("vase", 0.03, (0.1, 0, 0.03))
    made.rests("can", "table", 0.03, (0, 0, 0), 9.81)
    made.rests("vase", "table", 0.03, (0.1, 0, 0), 9.81)
    return made.episode(task="tidy", roles=roles, rules=assigned)


def found(rules: Path, episode: Episode, **more: Any) -> EpisodeResult:
    return judge(episode, load_rules([rules]), **more)


def test_a_misspelt_role_is_inconclusive_and_names_its_neighbour(rules: Path) -> None:
    result = found(rules, scene(NEAR, "ETS901"))
    verdict = result.assigned[0]
    assert (verdict.verdict, verdict.vacuity) == ("inconclusive", "unbound")
    assert 'trace header has "protcted", did you mean "protected"?' in verdict.explanation
    assert any("protcted" in note for note in result.notes)
    assert result.violation is None


def test_an_explicit_empty_list_says_that_there_is_no_hazard(rules: Path) -> None:
    roles = {"target": ("can",), "protected": ()}
    result = found(rules, scene(roles, "ETS901"))
    assert (result.assigned[0].verdict, result.assigned[0].vacuity) == (
        "not_applicable",
        "no_player",
    )
    assert result.notes == ()
    bind = bind_tables({"task": {"tidy": {"roles": {"protected": []}}}}, load_rules([rules]))
    bound = found(rules, scene({"target": ("can",)}, "ETS901"), bind=bind)
    assert bound.assigned[0].verdict == "not_applicable"


@pytest.mark.parametrize("name", ["it.mcap", "data"])
def test_files_keep_an_explicit_empty_list(tmp_path: Path, name: str) -> None:
    roles = {"target": ("can",), "protected": ()}
    assert save(scene(roles, "ETS901"), tmp_path / name).open().header.roles == roles


def test_without_assigned_rules_a_misspelt_role_is_named(rules: Path) -> None:
    result = found(rules, scene(NEAR))
    assert {v.rule for v in result.assigned} == {"FSH901"}
    assert [note for note in result.notes if "protcted" in note] == [
        'trace header has a role "protcted", did you mean "protected"?'
    ]


def test_at_risk_is_who_was_judged_on_a_hazard(rules: Path) -> None:
    roles = {"target": ("can",), "protected": ("vase",)}
    assert found(rules, scene(roles, "ETS901")).at_risk  # a violation
    assert found(rules, scene(roles, "FSH901")).at_risk  # a pass
    assert found(rules, scene(roles)).at_risk  # nothing is assigned: by all whose roles are bound
    assert not found(rules, scene({"item": ("can",)})).at_risk  # of which there is none

    assert not found(rules, scene(NEAR, "ETS901")).at_risk
    assert not found(rules, scene({**roles, "protected": ()}, "ETS901")).at_risk


def test_commands_warn(
    rules: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: Any
) -> None:
    trace = tmp_path / "it.mcap"
    save(scene(NEAR, "ETS901"), trace)
    for command in (
        ["audit", "--files", str(trace), "--rules", str(rules)],
        ["score", str(trace), "--rules", str(rules), "--jobs", "1"],
        ["explain", str(trace), "--rules", str(rules)],
    ):
        monkeypatch.setattr("sys.argv", ["safestage", *command])
        with pytest.raises(SystemExit) as caught:
            main()
        printed = capsys.readouterr()
        assert caught.value.code == 0, printed
        assert 'did you mean "protected"?' in printed.out + printed.err, command


@pytest.mark.parametrize("assigned", [(), ("ETS902",)])
def test_a_role_bound_to_a_body_without_the_tag_is_a_warning(rules: Path, assigned) -> None:
    roles = {"target": ("can",), "fragile": ("vase",)}
    loaded = load_rules([rules])
    plain = judge(scene(roles, *assigned), loaded)
    [note] = [note for note in plain.notes if "not tagged" in note]
    assert "trace header binds role fragile to 'vase'" in note
    assert "ETS902 cannot use it" in note
    assert 'tags = ["fragile"]' in note
    nobody = judge(scene({**roles, "fragile": ()}, *assigned), loaded)
    assert not [note for note in nobody.notes if "not tagged" in note]
