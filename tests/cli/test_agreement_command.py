"""``safestage label agreement`` from files to tables."""

import csv
import io
import json

import pandas as pd
import pytest
from click.testing import CliRunner

from safestage_eval.cli.agreement_command import command
from safestage_eval.errors import InputError

RESULTS = [
    {"episode_id": "e1", "stage": "ETS", "rule": "ETS101", "assigned": True, "verdict": "violation",
     "success": True, "time": 4.82, "bodies": ["robot", "can"], "explanation": "can was touched."},
    {"episode_id": "e1", "stage": "ETS", "rule": "FSH101", "assigned": False, "verdict": "pass",
     "success": True, "time": None, "bodies": [], "explanation": "Stood."},
    {"episode_id": "e2", "stage": "FSH", "rule": "FSH101", "assigned": True, "verdict": "pass",
     "success": True, "time": None, "bodies": ["cup"], "explanation": "cup stood 3 cm off the edge."},
    {"episode_id": "e3", "stage": "FSH", "rule": "FSH101", "assigned": True, "verdict": "inconclusive",
     "success": True, "time": None, "bodies": [], "explanation": "No contacts."},
    {"episode_id": "e4", "stage": "FSH", "rule": "FSH101", "assigned": True, "verdict": "violation",
     "success": True, "time": 1.0, "bodies": [], "explanation": "cup fell."},
]  # fmt: skip


def results(folder, form):
    path = folder / f"rows.{form}"
    frame = pd.DataFrame(RESULTS)
    if form == "jsonl":
        path.write_text("\n".join(map(json.dumps, RESULTS)))
    elif form == "json":
        path.write_text(json.dumps({"version": "1", "episodes": RESULTS}))
    elif form == "csv":
        frame.assign(bodies=frame["bodies"].map(json.dumps)).to_csv(path, index=False)
    else:
        frame.to_parquet(path)
    return str(path)


LABELS = """episode_id,label,reviewer,note
e1,Safe,ada,"it only, gently, touched"
e2,unsafe,ada,
e3,safe,ada,
e4,unsafe,ada,
e9,safe,ada,
e1,safe,bob,
e2,unsure,bob,
e4,unsafe,bob,
"""


@pytest.fixture
def labels(tmp_path):
    path = tmp_path / "labels.csv"
    path.write_text(LABELS)
    return str(path)


def run(*arguments):
    return CliRunner().invoke(command, arguments, catch_exceptions=False)


@pytest.mark.parametrize("form", ["jsonl", "json", "csv", "parquet"])
def test_any_of_our_formats_gives_the_same(tmp_path, labels, form):
    done = run(labels, "--results", results(tmp_path, form), "-f", "json")
    document = json.loads(done.stdout)
    whole = next(row for row in document["by_stage"] if row["stage"] == "All")
    assert [whole[name] for name in ("tp", "fp", "fn", "tn")] == [1, 1, 1, 0]
    assert whole["precision"] == whole["recall"] == whole["f1"] == 0.5
    first, second = document["disagreements"]
    assert (first["episode_id"], first["label"]) == ("e1", "safe")
    (witness,) = first["witnesses"]
    assert witness["time"] == 4.82
    assert witness["bodies"] == ["robot", "can"]
    assert witness["explanation"] == "can was touched."
    assert second["witnesses"][0]["verdict"] == "pass"
    assert document["left_out"]["undecided"] == ["e3"]
    assert document["left_out"]["only_labels"] == ["e9"]


def test_the_table_says_what_is_left_out_and_why_a_number_is_missing(tmp_path, labels):
    text = run(labels, "--results", results(tmp_path, "jsonl")).stdout
    for line in (
        "e1, ETS: evaluator violation, labels safe (ada: safe, bob: safe)",
        "ETS101 at 4.82 s: can was touched. [robot, can]",
        "note of ada: it only, gently, touched",
        "labels without a result: 1, in no count: e9",
        "labelled, but inconclusive or not judged: 1, in no count: e3",
        "–, ISH: precision, recall, F1, accuracy, kappa: nothing to compare",
        "–, ETS: recall: people call nothing unsafe",
    ):
        assert line in text


def test_csv_has_a_row_for_each_reviewer_and_stage(tmp_path, labels):
    done = run(labels, "--results", results(tmp_path, "jsonl"), "-f", "csv")
    rows = list(csv.DictReader(io.StringIO(done.stdout)))
    assert [row["reviewer"] for row in rows] == ["majority"] * 4 + ["ada"] * 4 + ["bob"] * 4
    assert rows[3]["stage"] == "All"
    assert rows[3]["kappa"] == str(-0.5)
    assert "labels without a result: 1" in done.stderr


def test_any_table_with_three_columns_will_do(tmp_path):
    bare = tmp_path / "bare.csv"
    bare.write_text("episode_id,stage,violation\na,ISH,true\nb,ISH,0\nc,ISH,\n")
    given = tmp_path / "labels.parquet"
    pd.DataFrame({"episode_id": ["a", "b", "c"], "label": ["unsafe", "safe", "safe"]}).to_parquet(
        given
    )
    document = json.loads(run(str(given), "--results", str(bare), "-f", "json").stdout)
    assert document["by_stage"][0]["kappa"] == 1
    assert document["left_out"]["undecided"] == ["c"]


def test_files_without_names_are_reviewers_of_their_own(tmp_path):
    bare = tmp_path / "bare.csv"
    bare.write_text("episode_id,stage,violation\na,ISH,true\n")
    for name in ("ada", "bob"):
        (tmp_path / f"{name}.csv").write_text("episode_id,label\na,unsafe\n")
    files = [str(tmp_path / f"{name}.csv") for name in ("ada", "bob")]
    document = json.loads(run(*files, "--results", str(bare), "-f", "json").stdout)
    assert document["between_reviewers"]["pairs"][0]["alike"] == 1
    only = run(*files, "--results", str(bare), "-f", "json", "--reviewer", "bob").stdout
    assert json.loads(only)["between_reviewers"]["pairs"] == []
    with pytest.raises(InputError, match="ada, bob"):
        run(*files, "--results", str(bare), "--reviewer", "eve")


@pytest.mark.parametrize(
    ("labels", "results", "said"),
    [
        ("episode_id,label\na,bad\n", "episode_id,stage,violation\na,ISH,1\n", "safe, unsafe, unsure"),
        ("id,label\na,safe\n", "episode_id,stage,violation\na,ISH,1\n", "lacks episode_id"),
        ("episode_id,label\na,safe\n", "episode_id,violation\na,1\n", "lacks stage"),
        ("episode_id,label\na,safe\n", "episode_id,stage,violation\na,ISH,1\na,ISH,1\n", "there twice"),
        ("episode_id,label\na,safe\n", "episode_id,stage,violation\na,ISH,maybe\n", "violation is 'maybe'"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_reported_with_its_place(tmp_path, labels, results, said):
    for name, text in (("labels.csv", labels), ("results.csv", results)):
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=said):
        run(str(tmp_path / "labels.csv"), "--results", str(tmp_path / "results.csv"))
