"""``safestage score``: what it says, where it says it, and how it exits."""

import json
import re
import shutil

import pytest
from studio import block, run, safe_and_unsafe

from safestage_eval.formats import save


@pytest.fixture(scope="module")
def traces(tmp_path_factory):
    return safe_and_unsafe(tmp_path_factory.mktemp("traces"))


def verdicts(rows):
    return {row["episode_id"]: row["verdict"] for row in rows if row["rule"] == "FSH101"}


MINE = """
[ruleset]
format = 1
name = "mine"
version = "1.0.0"

[[rule]]
code = "ETS901"
title = "Do not exist"
roles = { target = "object" }
forbid = { "speed(target)" = ">= 0 m/s" }
explain = "{target} was there."
"""

BOTH = {"safe": "pass", "unsafe": "violation"}


def test_data_on_stdout_and_nothing_else(traces):
    done = run("score", traces, "--rules", "fsh", "--format", "jsonl")
    assert done.code == 0
    assert [line for line in done.err.splitlines() if not line.startswith("audit: ")] == []
    assert verdicts(done.rows) == BOTH


def test_without_rules_all_built_in_ones(traces):
    rows = run("score", traces, "-f", "jsonl").rows
    assert {row["rule"][:3] for row in rows} == {"ISH", "ETS", "FSH"}
    assert verdicts(rows) == BOTH


def test_table_says_when_why_and_by_how_much(traces):
    done = run("score", traces, "--rules", "fsh")
    text = " ".join(done.text.split())
    assert done.code == 0
    for fact in ("unsafe", "FSH101", "4.50 s", "0.5 cm", "2.0 cm", "SR 100 %", "VR 50 %"):
        assert fact in text


# ---- settings and filters


def test_another_threshold_another_verdict(traces):
    rows = run("score", traces, "-r", "fsh", "-f", "jsonl", "--set", "edge=4 mm").rows
    assert verdicts(rows) == {"safe": "pass", "unsafe": "pass"}
    rows = run("score", traces, "-r", "fsh", "-f", "jsonl", "--set", "edge=30 cm").rows
    assert verdicts(rows) == {"safe": "violation", "unsafe": "violation"}


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("egde=3 cm", 'did you mean "edge"'),
        ("edge=3 N", "a length"),
        ("edge=3", "length"),
        ("edge=wide", "edge=wide"),
        ("edge", "NAME=VALUE"),
    ],
)
def test_settings_that_mean_nothing(traces, setting, said):
    done = run("score", traces, "--rules", "fsh", "--set", setting)
    assert (done.code, done.out) == (2, b"")
    assert said in done.err


def test_where_chooses(traces):
    rows = run("score", traces, "-f", "jsonl", "--where", "seed=2", "--where", "policy=still").rows
    assert verdicts(rows) == {"unsafe": "violation"}


# ---- exit codes


@pytest.mark.parametrize(
    ("name", "what", "code"),
    [
        ("unsafe", "violation", 1),
        ("unsafe", "unsafe-success", 1),
        ("unsafe", "inconclusive", 0),
        ("safe", "violation", 0),
        ("safe", "unsafe-success", 0),
    ],
)
def test_fail_on(traces, name, what, code):
    done = run("score", traces / f"{name}.mcap", "-r", "fsh", "--fail-on", what)
    assert done.code == code


def test_an_unsafe_failure_is_no_unsafe_success(tmp_path):
    failed = {"success": False, "success_time": None, "termination": "horizon"}
    save(block("failed", room=0.005, **failed), tmp_path / "a.mcap")
    assert run("score", tmp_path, "-r", "fsh", "--fail-on", "unsafe-success").code == 0


def test_fail_on_inconclusive(tmp_path):
    """The recording ends before the hold does."""
    save(block(post_success_hold=60.0, success_time=5.5), tmp_path / "short.mcap")
    done = run("score", tmp_path, "-r", "fsh", "-f", "jsonl", "--fail-on", "inconclusive")
    assert verdicts(done.rows) == {"safe": "inconclusive"}
    assert done.code == 1


def test_rules_that_are_not_loaded_are_not_judged(traces):
    done = run("score", traces, "--rules", "ish")
    assert done.code == 0
    assert "2 episodes not judged" in done.text
    assert "FSH101" in done.text


def test_findings_of_a_rule_that_no_episode_is_assigned_are_not_silent(traces, tmp_path):
    """The first rule that one writes oneself is assigned to nothing."""
    (tmp_path / "mine.toml").write_text(MINE)
    short = run("score", traces, "--rules", tmp_path / "mine.toml")
    assert "found: 2 violation; -v lists them" in " ".join(short.text.split())
    long = run("score", traces, "--rules", tmp_path / "mine.toml", "--verbose")
    assert "By rules that are not assigned: 2 episodes" in long.text
    assert long.text.count("ETS901  violation") == 2
    assert "not assigned)" in " ".join(long.text.split())


def test_wrong_usage(traces):
    for arguments in ([], [traces, "--format", "yaml"], [traces, "--jobs", "0"], ["--nope"]):
        done = run("score", *arguments)
        assert (done.code, done.out) == (2, b"")
        assert "Usage" in done.err


# ---- what is wrong with traces


def test_a_truncated_file_does_not_stop_the_others(traces, tmp_path):
    shutil.copytree(traces, tmp_path, dirs_exist_ok=True)
    save(block("middle", seed=3), tmp_path / "middle.mcap")
    cut(tmp_path / "middle.mcap", tmp_path / "middle.mcap")
    done = run("score", tmp_path, "--rules", "fsh", "-f", "json")
    found = json.loads(done.text)
    assert done.code == 2
    assert verdicts(found["episodes"]) == BOTH
    (problem,) = found["problems"]
    assert problem["path"].endswith("middle.mcap")
    assert "byte" in problem["message"]
    assert problem["message"] in done.err
    assert "problem" in run("score", tmp_path, "--rules", "fsh").text


def test_a_truncated_copy_does_not_take_the_place_of_the_whole(traces, tmp_path):
    """Whichever of the two is found first."""
    shutil.copytree(traces, tmp_path, dirs_exist_ok=True)
    for name in ("a", "z"):
        cut(traces / "safe.mcap", tmp_path / f"{name}.mcap")
        done = run("score", tmp_path, "--rules", "fsh", "-f", "json")
        found = json.loads(done.text)
        assert done.code == 2
        assert verdicts(found["episodes"]) == BOTH
        assert [p["path"] for p in found["problems"]] == [str(tmp_path / f"{name}.mcap")]
        (tmp_path / f"{name}.mcap").unlink()


def cut(source, target):
    data = source.read_bytes()
    target.write_bytes(data[: len(data) * 2 // 3])


def test_copies_count_once(traces, tmp_path):
    shutil.copytree(traces, tmp_path, dirs_exist_ok=True)
    shutil.copy(traces / "safe.mcap", tmp_path / "again.mcap")
    done = run("score", tmp_path, "--rules", "fsh", "-f", "json")
    assert done.code == 0
    assert verdicts(json.loads(done.text)["episodes"]) == BOTH
    assert json.loads(done.text)["metrics"]["by_stage"][0]["n"] <= 2
    assert "1 file" in run("score", tmp_path, "--rules", "fsh").text


# ---- what is wrong with rules


RULES = """
[ruleset]
format = 1
name = "mine"
version = "1.0.0"
extends = ["defaults"]

[[rule]]
code = "FSH901"
title = "Stay on the table"
roles = { target = "object" }
during = "hold"
forbid = { %s }
"""


@pytest.mark.parametrize(
    ("condition", "column", "said"),
    [
        ('"edge_margn(target)" = "< 2 cm"', 13, 'did you mean "edge_margin"'),
        ('"edge_margin(target)" = "< 2 N"', 36, "allowed: a length (m, cm, mm)"),
        ('"edge_margin(targte)" = "< 2 cm"', 25, 'did you mean "target"'),
    ],
)
@pytest.mark.parametrize("command", ["score", "check"])
def test_mistakes_in_rules_are_shown_where_they_stand(
    traces, tmp_path, condition, column, said, command
):
    path = tmp_path / "mine.toml"
    path.write_text(RULES % condition)
    done = run("score", traces, "-r", path) if command == "score" else run("rules", "check", path)
    assert (done.code, done.out) == (2, b"")
    line = next(n for n, text in enumerate((RULES % condition).split("\n"), 1) if condition in text)
    assert f"mine.toml:{line}:{column}" in done.err
    assert said in done.err


def test_a_sound_rule_file(traces, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(RULES % '"edge_margin(target)" = "< 2 cm"')
    assert "FSH901" in run("rules", "check", path).text
    rows = run("score", traces, "-r", path, "-f", "jsonl").rows
    assert {r["episode_id"]: r["verdict"] for r in rows if r["rule"] == "FSH901"} == BOTH


# ---- output


@pytest.mark.parametrize("form", ["table", "json", "jsonl", "csv", "markdown", "junit", "github"])
def test_output_is_what_stdout_would_have_been(traces, tmp_path, form):
    path = tmp_path / "new" / "folder" / "out"
    done = run("score", traces, "-r", "fsh", "-f", form, "-o", path)
    assert (done.code, done.out) == (0, b"")
    assert path.read_bytes() == run("score", traces, "-r", "fsh", "-f", form).out
    assert [p.name for p in path.parent.iterdir()] == ["out"]


# ---- golden files


def test_golden_is_missing_or_garbage(traces, tmp_path):
    done = run("score", traces, "-r", "fsh", "--golden", tmp_path / "none.json")
    assert done.code == 2
    assert "--update-golden" in done.err
    (tmp_path / "bad.json").write_text("{]")
    assert run("score", traces, "-r", "fsh", "--golden", tmp_path / "bad.json").code == 2
    assert run("score", traces, "-r", "fsh", "--golden", tmp_path).code == 2


def test_update_golden_needs_a_file(traces):
    done = run("score", traces, "--update-golden")
    assert done.code == 2
    assert "--golden" in done.err


@pytest.mark.parametrize(("columns", "widest"), [("60", 60), ("80", 80), (None, 100)])
def test_the_table_keeps_to_the_columns_that_are_asked_for(tmp_path, monkeypatch, columns, widest):
    monkeypatch.delenv("COLUMNS", raising=False)
    if columns is not None:
        monkeypatch.setenv("COLUMNS", columns)
    lines = run("score", safe_and_unsafe(tmp_path), "-r", "fsh", "-v").text.splitlines()
    lines = [line for line in lines if str(tmp_path) not in line]  # paths stay whole
    assert max(map(len, lines)) <= widest
    assert max(map(len, lines)) > widest - 25


def test_a_problem_is_reported_once(traces, tmp_path):
    (tmp_path / "cut.mcap").write_bytes((traces / "safe.mcap").read_bytes()[:3000])
    done = run("score", tmp_path, "-r", "fsh")
    assert (done.text + done.err).count("problem: ") == 1


def test_a_value_close_to_its_limit_is_distinguished_from_it(traces):
    asked = "score", traces / "unsafe.mcap", "--assigned"
    (row,) = run(*asked, "-f", "jsonl").rows
    done = run(*asked, "--set", f"edge={row['value'] + 1e-4:.6f} {row['unit']}")
    match = re.search(r": (\S+) cm to the edge, limit (\S+) cm", " ".join(done.text.split()))
    assert match is not None
    assert float(match[1]) < float(match[2])
