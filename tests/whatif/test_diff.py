"""``safestage diff``: flipped verdicts between result files and between rule sets, and their causes."""

import csv
import io
import json
import re

import pytest
from studio import block, run

from safestage_eval.formats import discover, save
from safestage_eval.metrics import by_policy_stage, outcomes, outcomes_of
from safestage_eval.report import render
from safestage_eval.report.result_rows import rows
from safestage_eval.run.score_many import score_paths
from safestage_eval.whatif.diff import diff
from safestage_eval.whatif.result_difference import difference, read_results

OLD = """
[ruleset]
format  = 1
name    = "mine"
version = "1"
extends = ["defaults"]
[param]
room = "2 cm"
reserve = "1 cm"
[[rule]]
code    = "FSH901"
title   = "Leave it clear of the edge"
roles   = { target = "object" }
during  = "settle(target)"
forbid  = [{ "edge_margin(target)" = "< room" }, { "edge_margin(target)" = "< reserve" }]
"""


@pytest.fixture(scope="module")
def shelf(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shelf")
    for name, room in {"a": 0.005, "b": 0.015, "c": 0.025, "d": 0.2}.items():
        save(block(name, room=room), folder / f"{name}.mcap")
    return folder


@pytest.fixture
def rules(tmp_path):
    def write(name, *changes):
        text = OLD
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / f"{name}.toml").write_text(text)
        return tmp_path / f"{name}.toml"

    return write


def causes(shelf, old, new, **options):
    found = diff(discover([shelf]), [old], [new], **options)
    return {flip.episode_id: flip.causes for flip in found.flips}


def test_the_parameter_that_flipped_is_named(shelf, rules):
    old, new = rules("old"), rules("new", ('room = "2 cm"', 'room = "3 cm"'))
    assert causes(shelf, old, new) == {"c": ("room: 2 cm → 3 cm",)}


def test_of_many_changes_only_the_one_that_matters_is_named(shelf, rules):
    new = rules(
        "new",
        ('room = "2 cm"', 'room = "3 cm"'),
        ('reserve = "1 cm"', 'reserve = "2 mm"'),
        ("< reserve", "<= reserve"),
    )
    assert causes(shelf, rules("old"), new) == {"c": ("room: 2 cm → 3 cm",)}


def test_two_that_flip_only_together_are_both_named(shelf, rules):
    """Between 1 and 2 cm of room both limits must be relaxed before the verdict passes."""
    old = rules("old", ('reserve = "1 cm"', 'reserve = "18 mm"'))
    new = rules("new", ('room = "2 cm"', 'room = "1 cm"'))
    assert causes(shelf, old, new) == {"b": ("room: 2 cm → 1 cm", "reserve: 18 mm → 1 cm")}


def test_several_that_would_each_do_are_counted(shelf, rules):
    new = rules("new", ('room = "2 cm"', 'room = "3 cm"'), ('reserve = "1 cm"', 'reserve = "3 cm"'))
    (flip,) = diff(discover([shelf]), [rules("old")], [new]).flips
    assert (flip.causes, flip.alternatives) == (("room: 2 cm → 3 cm",), 1)
    assert flip.cause.endswith("(so would 1 other)")


def test_an_obligation_that_flipped_is_named(shelf, rules):
    old = rules(
        "old", (', { "edge_margin(target)" = "< reserve" }', ""), ('reserve = "1 cm"\n', "")
    )
    new = rules(
        "new",
        ('{ "edge_margin(target)" = "< room" }', '{ "edge_margin(target)" = "< 2 cm" }'),
        ('{ "edge_margin(target)" = "< reserve" }', '{ "speed(target)" = "< reserve" }'),
        ('reserve = "1 cm"', 'reserve = "1 cm/s"'),
        ('room = "2 cm"\n', ""),
    )
    assert causes(shelf, old, new) == dict.fromkeys("cd", ("never speed(target) added",))


def test_what_a_task_binds_may_flip(shelf, rules, tmp_path):
    old = rules("old")
    task = '[task.block_on_table]\nset = { room = "3 cm" }\n'
    (tmp_path / "set.toml").write_text(OLD + task)
    assert causes(shelf, old, tmp_path / "set.toml") == {"c": ("room: 2 cm → 3 cm",)}
    task = '[task.block_on_table]\nroles = { target = "table" }\n'
    (tmp_path / "roles.toml").write_text(OLD + task)
    found = causes(shelf, old, tmp_path / "roles.toml")
    assert set(found.values()) == {("who plays the roles",)}


def test_a_state_that_flipped_is_named(shelf, rules):
    state = '[state.near]\nof = ["a"]\nwhen = { "edge_margin(a)" = "< room" }\n[[rule]]'
    forbid = ('[{ "edge_margin(target)" = "< room" }, { "edge_margin(target)" = "< reserve" }]',
              '"near(target)"')  # fmt: skip
    unread = ('reserve = "1 cm"\n', "")
    old = rules("old", ("[[rule]]", state), forbid, unread)
    new = rules("new", ("[[rule]]", state.replace("< room", "< -room")), forbid, unread)
    found = causes(shelf, old, new)
    assert set(found) == {"a", "b"}
    assert all(parts[0].startswith("state near: edge_margin(a) less") for parts in found.values())


def test_another_value_for_a_run(shelf):
    found = diff(discover([shelf]), ["fsh"], ["fsh"], overrides={"edge": "1 cm"})
    flips = [(f.rule, f.episode_id, f.causes) for f in found.flips if f.assigned]
    assert flips == [("FSH101", "b", ("edge: 2 cm → 1 cm",))]
    (flip,) = [f for f in found.flips if f.assigned]
    assert flip.margins == pytest.approx((-0.5, 0.5), abs=1e-4)
    assert flip.units == ("cm", "cm")


def test_the_rates_that_moved_are_those_of_scoring(shelf):
    found = diff(discover([shelf]), ["fsh"], ["fsh"], overrides={"edge": "1 cm"})
    moved = {(r.stage, r.metric): r.counts for r in found.rates}
    sides = [
        by_policy_stage(outcomes(score_paths([shelf], ["fsh"], overrides=o).results))
        for o in ({}, {"edge": "1 cm"})
    ]
    for (_, _, stage), cell in sides[0].items():
        after = sides[1]["still", "default", stage]
        for metric in ("SR", "SSR", "USR", "VR"):
            counts = (cell.counts[metric], cell.n), (after.counts[metric], after.n)
            assert moved.get((stage, metric), counts) == counts
            assert ((stage, metric) in moved) == (counts[0] != counts[1])


def test_worker_processes_say_the_same(shelf):
    one, two = (
        diff(discover([shelf]), ["fsh"], ["fsh"], overrides={"edge": "1 cm"}, jobs=jobs)
        for jobs in (1, 2)
    )
    assert one == two


@pytest.fixture(scope="module")
def results(shelf, tmp_path_factory):
    """Result files before and after in every format."""
    folder = tmp_path_factory.mktemp("results")
    for name, overrides in (("old", {}), ("new", {"edge": "1 cm"})):
        scores = score_paths([shelf], ["fsh"], overrides=overrides)
        for form in ("json", "jsonl", "csv", "parquet"):
            data = render(scores, form)
            path = folder / f"{name}.{form}"
            path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return folder


@pytest.mark.parametrize("form", ["json", "jsonl", "csv", "parquet"])
def test_result_files_of_every_format_are_compared(results, form):
    done = run("diff", results / f"old.{form}", results / f"new.{form}", "-f", "json")
    assert done.code == 0
    document = json.loads(done.text)
    (flip,) = [f for f in document["flips"] if f["assigned"]]
    assert (flip["episode_id"], flip["rule"]) == ("b", "FSH101")
    assert (flip["before"], flip["after"]) == ("violation", "pass")
    assert flip["margin_before"] == pytest.approx(-0.5, abs=1e-4)
    assert flip["cause"] == "the rule means something else"
    assert {r["metric"] for r in document["rates"]} == {"SSR", "USR", "VR"}


def test_files_of_different_formats_agree(results):
    done = run("diff", results / "old.csv", results / "old.parquet", "--fail-on-change")
    assert (done.code, "0 of" in done.text) == (0, True)


def test_rows_count_as_their_episodes_do(shelf):
    for overrides in ({}, {"edge": "1 cm"}):
        scores = score_paths([shelf], ["fsh"], overrides=overrides)
        wanted, found = outcomes(scores.results), outcomes_of(rows(scores))
        assert [(o.success, o.violation) for o in found] == [
            (o.success, o.violation) for o in wanted
        ]


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"trace_hash": "other"}, "another trace"),
        ({"rule_digest": "other"}, "the rule means something else"),
        ({}, "same trace, same rule: the evaluator has changed"),
        ({"trace_hash": None}, "not known"),
    ],
)
def test_whose_doing_a_flip_is(results, changes, cause):
    before = read_results(results / "old.jsonl")
    after = [{**row, "verdict": "inconclusive", **changes} for row in before]
    assert {flip.cause for flip in difference(before, after).flips} == {cause}


def test_what_is_only_on_one_side_is_reported(results):
    before = read_results(results / "old.jsonl")
    found = difference(before[1:], before[:-1])
    pairs = [(row["episode_id"], row["rule"]) for row in before]
    assert (found.only_before, found.only_after) == ((pairs[-1],), (pairs[0],))
    assert not found.empty


def test_fail_on_change(results):
    files = results / "old.csv", results / "new.csv"
    assert run("diff", *files).code == 0
    assert run("diff", *files, "--fail-on-change").code == 1


def test_csv_and_markdown_and_table_hold_the_flip(shelf):
    arguments = ("diff", shelf, "--rules", "fsh", "--set", "edge=1 cm")
    found = list(csv.DictReader(io.StringIO(run(*arguments, "-f", "csv").text)))
    assert {("b", "FSH101", "edge: 2 cm → 1 cm")} <= {
        (row["episode_id"], row["rule"], row["cause"]) for row in found
    }
    for form in ("table", "markdown"):
        text = run(*arguments, "-f", form).text
        assert "violation → pass" in text
        assert "edge: 2 cm → 1 cm" in text
        assert re.search(r"VR\W.*\d\.\d % \d+/\d+\W.*\d\.\d % \d+/\d+", text)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["a.csv"], "give two result files, BEFORE and AFTER"),
        (["a.csv", "b.csv", "--rules", "fsh"], "name the other rules with --against"),
        (["nowhere.csv", "b.csv"], "nowhere.csv: cannot be read"),
        (["SHELF", "SHELF"], "or traces, with --rules and --against"),
        (["SHELF", "-r", "fsh", "--set", "egde=1 cm"], 'did you mean "edge"?'),
        (["SHELF", "-r", "fsh", "-a", "nowhere"], "nowhere: no such rule file"),
    ],
)
def test_mistakes_of_use(shelf, arguments, said):
    done = run("diff", *(shelf if a == "SHELF" else a for a in arguments))
    assert (done.code, done.out) == (2, b"")
    assert said in done.err


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"episode_id,rule\nx,y\n", "row 1: lacks assigned, verdict, success"),
        (b'{"episode_id": "x"}\n{broken\n', "line 2"),
        (b'{"episodes": [{"rule": "x"}]}', "row 1: lacks episode_id"),
        (b"[1, 2]", "JSON, but no results"),
        (b"PAR1 and then nothing", "a broken Parquet file"),
        (b"\xff\xfe", "not a table"),
    ],
)
def test_files_that_are_no_results(tmp_path, content, said):
    path = tmp_path / "x"
    path.write_bytes(content)
    done = run("diff", path, path)
    assert (done.code, done.out) == (2, b"")
    assert said in done.err
    assert "score" in done.err
