"""``safestage report tables`` as a user meets it, with good and with bad input."""

import csv
import io
import json
import re

import pytest
from campaign import campaign, frame
from studio import run, safe_and_unsafe


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    path = tmp_path_factory.mktemp("outcomes") / "table.csv"
    frame(campaign(5)).to_csv(path, index=False)
    return path


def test_json_has_the_two_tables(table):
    done = run("report", "tables", table, "-f", "json")
    found = json.loads(done.text)
    assert (done.code, done.err, found["problems"]) == (0, "", [])
    assert [*found["by_policy"][0]] == [
        "policy", "prompt", "metric", "mean", "std", "k", "n", "n_seeds",
    ]  # fmt: skip
    assert [*found["by_stage"][0]] == [
        "prompt", "stage", "metric", "mean", "std", "k", "n", "n_seeds",
    ]  # fmt: skip
    assert {row["metric"] for row in found["by_policy"]} == {
        "SR", "SSR", "USR", "ISH-VR", "ETS-VR", "FSH-VR",
    }  # fmt: skip
    assert {row["metric"] for row in found["by_stage"]} == {"SR", "SSR", "USR", "VR"}
    for total in found["quadrants"]:
        assert total["n"] == sum(
            v for name, v in total.items() if "success" in name or "fail" in name
        )


def test_every_format_tells_the_same_numbers(table):
    rows = json.loads(run("report", "tables", table, "-f", "json").text)
    cells = [f"{r['mean']:.2f} ± {r['std']:.2f}" for name in ("by_policy", "by_stage", "by_family")
             for r in rows[name]]  # fmt: skip
    for form in ("table", "markdown"):
        text = run("report", "tables", table, "-f", form).text
        assert re.findall(r"\d+\.\d\d ± \d+\.\d\d", text) == cells
    latex = run("report", "tables", table, "-f", "latex").text
    found = re.findall(r"\$(\d+\.\d\d)\\,\{\\scriptstyle\\pm\\,(\d+\.\d\d)\}\$", latex)
    own = len(rows["by_policy"]) + len(rows["by_stage"])  # the paper's two tables
    assert [f"{mean} ± {std}" for mean, std in found] == cells[:own]
    lines = list(csv.DictReader(io.StringIO(run("report", "tables", table, "-f", "csv").text)))
    assert [f"{float(li['mean']):.2f} ± {float(li['std']):.2f}" for li in lines] == cells


@pytest.mark.parametrize("form", ["table", "markdown", "latex"])
def test_coverage_comes_first(tmp_path, form):
    """Counts of the whole in the first line, of each row of rates in a column."""
    outcomes = campaign(5, open_share=0.4)
    frame(outcomes).to_csv(tmp_path / "open.csv", index=False)
    n, total = sum(o.decided for o in outcomes), len(outcomes)
    text = run("report", "tables", tmp_path / "open.csv", "-f", form).text
    first = next(line for line in text.splitlines() if "usepackage" not in line)
    assert first.strip("*% ") == f"Judged {n} of {total} episodes; {total - n} undecided"
    for policy in ("act", "pi0"):
        own = [o for o in outcomes if (o.policy, o.prompt) == (policy, "default")]
        rates = [
            line for line in text.splitlines() if re.search(f"{policy}.*default.*(±|pm)", line)
        ]
        (row,) = rates
        assert f"{sum(o.decided for o in own)}/{len(own)}" in row


def test_latex_is_balanced_and_escaped(tmp_path):
    names = frame(campaign(5)).replace({"policy": {"act": "a_c&t 50%"}})
    names.to_csv(tmp_path / "a.csv", index=False)
    text = run("report", "tables", tmp_path / "a.csv", "-f", "latex").text
    assert "a\\_c\\&t 50\\%" in text
    assert text.count("\\begin{") == text.count("\\end{") > 0
    body = "\n".join(line for line in text.splitlines() if not line.startswith("%"))
    assert body.count("{") == body.count("}")
    widths = {
        len(re.findall(r"(?<!\\)&", row))
        for part in body.split("\\toprule")[1:2]
        for row in part.split("\\bottomrule")[0].splitlines()
        if row.endswith("\\\\")
    }
    assert len(widths) == 1


def test_intervals_are_the_same_for_the_same_seed(table):
    options = ("--intervals", "bootstrap", "--random-seed")
    first, again, other = (run("report", "tables", table, *options, seed).text for seed in "778")
    assert first == again
    assert first != other
    assert run("report", "tables", table, "--intervals", "wilson").text.count("[") == first.count(
        "["
    )


def test_uneven_cells_are_reported_and_strict_about(tmp_path):
    frame(campaign(5)[1:]).to_csv(tmp_path / "a.csv", index=False)
    done = run("report", "tables", tmp_path / "a.csv", "-f", "json")
    assert done.code == 0
    assert (
        "uneven: act, default: 1 cell of 36 without the usual 4 rollouts: ish_0 seed 0 (3)"
        in done.err
    )
    (problem,) = json.loads(done.text)["problems"]
    assert problem["cells"] == [{"task": "ish_0", "seed": 0, "rollouts": 3, "expected": 4}]
    assert run("report", "tables", tmp_path / "a.csv", "--strict").code == 1


def test_bad_input_is_said_and_nothing_printed(tmp_path, table):
    for arguments, words in (
        ([tmp_path / "none.csv"], "cannot be read"),
        ([tmp_path], "is a folder"),
        ([table, table], "rollouts are there twice"),
        ([], "Missing argument"),
        ([table, "-f", "xml"], "xml"),
    ):
        done = run("report", "tables", *arguments)
        assert (done.code, done.out) == (2, b"")
        assert words in done.err


def test_from_traces_to_tables(tmp_path):
    (tmp_path / "traces").mkdir()
    traces = safe_and_unsafe(tmp_path / "traces")
    for form in ("json", "jsonl", "csv", "parquet"):
        assert run("score", traces, "-r", "fsh", "-f", form, "-o", tmp_path / form).code == 0
    texts = {
        run("report", "tables", tmp_path / form).text
        for form in ("json", "jsonl", "csv", "parquet")
    }
    (text,) = texts
    assert "50.00 [9, 91]" in text  # one rollout of each seed: no deviation, Wilson's interval
