"""``safestage compare verdicts``: flipped verdicts between result files and between rule sets, and their causes."""

import json

import pytest
from studio import block, run

from safestage_eval.formats import discover, save
from safestage_eval.metrics import by_policy_stage, outcomes
from safestage_eval.report import render
from safestage_eval.run.score_traces import score_paths
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


def test_two_that_flip_only_together_are_both_named(shelf, rules):
    """Between 1 and 2 cm of room both limits must be relaxed before the verdict passes."""
    old = rules("old", ('reserve = "1 cm"', 'reserve = "18 mm"'))
    new = rules("new", ('room = "2 cm"', 'room = "1 cm"'))
    assert causes(shelf, old, new) == {"b": ("room: 2 cm → 1 cm", "reserve: 18 mm → 1 cm")}


def test_who_plays_the_roles_may_flip(shelf, rules):
    old = rules("old")
    new = rules("new", ('target = "object" }', 'target = "object tagged precious" }'))
    assert set(causes(shelf, old, new).values()) == {("who plays the roles",)}


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
    done = run(
        "compare", "verdicts", results / f"old.{form}", results / f"new.{form}", "-f", "json"
    )
    assert done.code == 0
    document = json.loads(done.text)
    (flip,) = [f for f in document["flips"] if f["assigned"]]
    assert (flip["episode_id"], flip["rule"]) == ("b", "FSH101")
    assert (flip["before"], flip["after"]) == ("violation", "pass")
    assert flip["margin_before"] == pytest.approx(-0.5, abs=1e-4)
    assert flip["cause"] == "rule or parameter changed"
    assert {r["metric"] for r in document["rates"]} == {"SSR", "USR", "VR"}


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"trace_hash": "other"}, "another trace"),
        ({"rule_digest": "other"}, "rule or parameter changed"),
        ({}, "same trace, same rule: the evaluator has changed"),
        ({"trace_hash": None}, "not known"),
    ],
)
def test_whose_doing_a_flip_is(results, changes, cause):
    before = read_results(results / "old.jsonl")
    after = [{**row, "verdict": "inconclusive", **changes} for row in before]
    assert {flip.cause for flip in difference(before, after).flips} == {cause}


def test_fail_on_change(results):
    files = results / "old.csv", results / "new.csv"
    assert run("compare", "verdicts", *files).code == 0
    assert run("compare", "verdicts", *files, "--fail-on-change").code == 1


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
    done = run("compare", "verdicts", *(shelf if a == "SHELF" else a for a in arguments))
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
    done = run("compare", "verdicts", path, path)
    assert (done.code, done.out) == (2, b"")
    assert said in done.err
    assert "score" in done.err
