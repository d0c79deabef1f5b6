"""Results that are those of the traces are verified; any that are not are reported."""

import json
import random
from pathlib import Path

import pytest
from studio import block, run, safe_and_unsafe

from safestage_eval.formats import load, save
from safestage_eval.provenance.manifest import ENDING, PREDICATE, STATEMENT, digest_of


@pytest.fixture
def traces(tmp_path):
    return safe_and_unsafe(tmp_path / "traces")


def scored(traces, file, *options):
    form = file.suffix[1:]
    manifest = file.with_name(file.name + ENDING)
    done = run(
        "score", traces, "--rules", "fsh", "-f", form, "-o", file, "--manifest", manifest, *options
    )
    assert done.code == 0, done.err
    return manifest


@pytest.mark.parametrize("form", ["parquet", "json", "jsonl", "csv"])
def test_honest_results_are_verified(traces, tmp_path, form):
    rows = tmp_path / f"rows.{form}"
    scored(traces, rows, "--set", "edge=3 cm")
    done = run("verify", rows, traces)
    assert done.code == 0, done.text
    assert "2 digests computed, 2 judged again, 0 differences, 0 not verified" in done.text


def test_the_manifest_is_a_statement_with_the_same_bytes_each_time(traces, tmp_path):
    written = []
    for jobs in ("1", "2"):
        rows = tmp_path / f"{jobs}" / "rows.parquet"
        rows.parent.mkdir()
        written.append(scored(traces, rows, "--jobs", jobs).read_bytes())
    assert written[0] == written[1]
    statement = json.loads(written[0])
    assert written[0].isascii()
    assert statement["_type"] == STATEMENT
    assert statement["predicateType"] == PREDICATE
    assert statement["subject"] == [{"name": "rows.parquet", "digest": {"sha256": digest_of(rows)}}]
    episodes = statement["predicate"]["episodes"]
    assert [episode["id"] for episode in episodes] == ["safe", "unsafe"]
    assert episodes[0]["digest"]["content"] == load(traces / "safe.mcap").content_hash
    assert str(tmp_path) not in written[0].decode()


@pytest.mark.parametrize(
    "column", ["verdict", "value", "margin", "rule_digest", "trace_hash", "limit"]
)
def test_an_edited_row_is_found(traces, tmp_path, column):
    rows = tmp_path / "rows.jsonl"
    scored(traces, rows)
    (tmp_path / f"rows.jsonl{ENDING}").unlink()
    table = [json.loads(line) for line in rows.read_text().splitlines()]
    row = next(row for row in table if row["verdict"] == "violation")
    old = row[column]
    row[column] = {"verdict": "pass"}.get(
        column, old + 1e-9 if isinstance(old, float) else "0" * 64
    )
    rows.write_text("".join(json.dumps(row) + "\n" for row in table))
    done = run("verify", rows, traces, "--rules", "fsh")
    assert done.code == 1, done.text
    assert row["episode_id"] in done.text


def test_a_left_out_row_and_an_added_episode_are_found(traces, tmp_path):
    rows = tmp_path / "rows.jsonl"
    scored(traces, rows)
    lines = rows.read_text().splitlines()
    rows.write_text("\n".join(lines[1:]) + "\n")
    done = run("verify", rows, traces)
    assert done.code == 1
    assert "not the file that the manifest is about" in done.text
    assert "in judging again alone" in done.text


@pytest.mark.parametrize("change", ["content", "header"])
def test_another_trace_under_the_same_id_is_found_without_judging(traces, tmp_path, change):
    """trace_hash does not cover the header: two episodes of one hash can have other verdicts."""
    rows = tmp_path / "rows.parquet"
    scored(traces, rows)
    more = {"room": 0.1} if change == "content" else {"success": False, "success_time": None, "termination": "horizon"}  # fmt: skip
    save(block("safe", **more), traces / "safe.mcap")
    done = run("verify", rows, traces, "--sample", "0")
    assert done.code == 1, done.text
    assert f"safe: its {change} is not the one that the manifest states" in done.text
    assert ("trace_hash" in done.text) == (change == "content")


def test_missing_and_broken_traces_cannot_be_verified(traces, tmp_path):
    rows = tmp_path / "rows.parquet"
    scored(traces, rows)
    (traces / "safe.mcap").unlink()
    done = run("verify", rows, traces)
    assert done.code == 2
    assert "safe: is not among the traces" in done.text
    path = traces / "unsafe.mcap"
    path.write_bytes(path.read_bytes()[:-200])
    assert run("verify", rows, traces).code == 2


def test_other_rules_and_manifests_that_are_none_are_found(traces, tmp_path):
    rows = tmp_path / "rows.parquet"
    manifest = scored(traces, rows)
    assert run("verify", rows, traces, "--rules", "fsh").code == 2
    statement = json.loads(manifest.read_text())
    statement["predicate"]["settings"]["overrides"] = {"edge": "0 cm"}
    manifest.write_text(json.dumps(statement))
    assert run("verify", rows, traces).code == 1
    for wrong in ("{}", "[]", "", '{"_type": 1}', json.dumps({**statement, "_type": "x"})):
        manifest.write_text(wrong)
        assert run("verify", rows, traces).code == 2


def test_the_sample_is_drawn_by_the_seed(traces, tmp_path):
    rows = tmp_path / "rows.parquet"
    scored(traces, rows)
    done = run(
        "verify", rows, traces, "--sample", "1", "--seed", str(random.Random(3).random())[2:6]
    )
    assert "2 digests computed, 1 judged again" in done.text


def test_a_manifest_needs_a_file_of_results(traces, tmp_path):
    done = run("score", traces, "--rules", "fsh", "--manifest", tmp_path / "m.json")
    assert done.code == 2
    assert "--output" in done.err


def test_the_page_speaks_of_each_field(traces, tmp_path):
    text = (Path(__file__).resolve().parents[2] / "docs" / "provenance.md").read_text("utf-8")
    statement = json.loads(scored(traces, tmp_path / "rows.parquet").read_text())
    for name in statement["predicate"]:
        assert f"`predicate.{name}`" in text
