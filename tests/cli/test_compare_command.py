"""``safestage compare`` as a user meets it, with good and with bad input."""

import csv
import io
import json
import re

import polars as pl
import pytest
from campaign import campaign, frame
from studio import run, safe_and_unsafe

from safestage_eval.metrics.paired import newcombe


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """One file with both policies, and one for each."""
    folder = tmp_path_factory.mktemp("outcomes")
    table = frame(campaign(5))
    table.to_parquet(folder / "both.parquet")
    for policy in ("act", "pi0"):
        table[table.policy == policy].to_csv(folder / f"{policy}.csv", index=False)
    return folder


def test_two_files_are_as_one_with_by(files):
    two = run("compare", files / "act.csv", files / "pi0.csv", "-f", "json")
    one = run("compare", files / "both.parquet", "--by", "policy", "-f", "json")
    assert (two.code, one.code) == (0, 0)
    assert (two.text, two.err) == (one.text, one.err)
    found = json.loads(one.text)
    assert (found["a"], found["b"], found["by"], found["pairs"]) == ("act", "pi0", "policy", 288)
    assert found["paired_on"] == ["task", "prompt", "seed", "rollout"]


def test_the_first_line_counts_the_pairs(files, tmp_path):
    whole = run("compare", files / "act.csv", files / "pi0.csv").text
    assert whole.startswith("pi0: 1.4 points more success, 2.8 more unsafe successes. ")
    assert whole.splitlines()[0].endswith("Compared 288 of 288 pairs")
    frame(campaign(5, open_share=0.4)).to_parquet(tmp_path / "open.parquet")
    line = run("compare", tmp_path / "open.parquet", "--by", "policy").text.partition("\n")[0]
    counts = re.search(r"Compared (\d+) of 288 pairs; undecided (\d+)$", line)
    assert int(counts[1]) + int(counts[2]) == 288


def test_it_is_repeatable_and_csv_and_json_agree(files):
    arguments = "compare", files / "both.parquet", "--by", "prompt", "--where", "policy=act"
    text = run(*arguments, "-f", "csv").text
    assert run(*arguments, "-f", "csv").text == text
    assert run(*arguments, "-f", "csv", "--random-seed", "1").text != text
    lines = json.loads(run(*arguments, "-f", "json").text)["lines"]
    rows = list(csv.DictReader(io.StringIO(text)))
    assert [float(r["difference"]) for r in rows] == [line["difference"] for line in lines]
    assert {(r["a"], r["b"]) for r in rows} == {("default", "specific")}


def test_what_the_sample_cannot_carry_is_said(files):
    done = run("compare", files / "both.parquet", "--by", "policy", "--where", "task=ets_1")
    assert done.code == 0
    assert re.search(r"warning: VR: \d+ pairs (cannot carry|show no difference)", done.err)
    found = json.loads(run("compare", files / "both.parquet", "--by", "policy", "-f", "json").text)
    for line in found["lines"]:
        if line["level"] == "all" and not line["significant"]:
            assert any(said.startswith(line["metric"] + ":") for said in found["warnings"])


def test_rule_sets_from_a_column_and_from_two_files(tmp_path, files):
    table = pl.read_parquet(files / "both.parquet")
    other = table.with_columns(violation=~pl.col("violation"))
    table.write_parquet(tmp_path / "old.parquet")
    other.write_parquet(tmp_path / "new.parquet")
    both = pl.concat(
        [table.with_columns(rules=pl.lit("old")), other.with_columns(rules=pl.lit("new"))]
    )
    both.write_parquet(tmp_path / "both.parquet")
    two = json.loads(
        run("compare", tmp_path / "old.parquet", tmp_path / "new.parquet", "-f", "json").text
    )
    one = json.loads(
        run("compare", tmp_path / "both.parquet", "--by", "rules", "--between", "old", "new",
            "-f", "json").text
    )  # fmt: skip
    assert two["by"] == one["by"] == "rules"
    assert two["lines"] == one["lines"]
    (rate,) = [x for x in one["lines"] if (x["scope"], x["metric"]) == ("All", "SR")]
    assert (rate["only_a"], rate["only_b"], rate["p"]) == (0, 0, 1)


def test_rules_over_the_same_traces(tmp_path):
    (tmp_path / "traces").mkdir()
    traces = safe_and_unsafe(tmp_path / "traces")
    for name, edge in (("old", "2 cm"), ("new", "1 mm")):
        run("score", traces, "-r", "fsh", "--set", f"edge={edge}", "-f", "jsonl",
            "-o", tmp_path / name)  # fmt: skip
    found = json.loads(run("compare", tmp_path / "old", tmp_path / "new", "-f", "json").text)
    (violations,) = [x for x in found["lines"] if x["metric"] == "VR"]
    assert (found["by"], found["pairs"]) == ("rules", 2)
    assert (violations["only_a"], violations["only_b"]) == (1, 0)


def test_bad_input_is_said_and_nothing_printed(tmp_path, files):
    both = files / "both.parquet"
    frame(campaign(5, seeds=1)).query("policy == 'pi0'").assign(seed=77).to_csv(
        tmp_path / "other.csv", index=False
    )
    for arguments, words in (
        ([both], "say with --by"),
        ([both, both, both], "give A and B"),
        ([both, "--by", "policy", "--between", "act", "x"], "no policy 'x'; there are act, pi0"),
        ([both, "--by", "policy", "--between", "act", "act"], "name two with --between"),
        ([both, "--by", "rules"], "lacks rules"),
        ([both, "--by", "policy", "--where", "prompt=x"], "none of 288 outcomes is prompt=x"),
        ([both, "--by", "policy", "--where", "mood=x"], "there are task, stage"),
        ([files / "act.csv", both], "differ in more than one thing"),
        ([files / "act.csv", tmp_path / "other.csv"], "no rollout of one is there in the other"),
        ([files / "act.csv", tmp_path / "none.csv"], "cannot be read"),
        ([files / "act.csv", files / "act.csv", "--by", "policy"], "both sides are 'act'"),
    ):
        done = run("compare", *arguments)
        assert (done.code, done.out) == (2, b""), arguments
        assert words in done.err


def test_no_violation_in_72_pairs_still_has_an_interval(tmp_path):
    rows = ["episode_id,task,policy,prompt,stage,seed,rollout,success,violation"]
    rows += [
        f"t{task}.{policy},t{task},{policy},default,ETS,0,0,true,false"
        for task in range(72)
        for policy in "ab"
    ]
    table = tmp_path / "rows.csv"
    table.write_text("\n".join(rows), "utf-8")
    text = run("compare", str(table), "--by", "policy").text
    assert "0.00 … 0.00" not in text
    low, high = newcombe(72, 0, 0, 0, 0)
    (line,) = [line for line in text.splitlines() if re.match(r"\s+VR +72 +0\.00 +0\.00", line)]
    assert f"{100 * low:.2f} … +{100 * high:.2f}" in line
