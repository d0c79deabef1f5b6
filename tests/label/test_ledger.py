"""Answers are on disk when they count, and none is lost."""

import csv
import signal
import subprocess
import sys
import threading

import pytest

from safestage_eval.errors import InputError
from safestage_eval.label import Ledger
from safestage_eval.metrics.labels import Label


def rows(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_an_answer_is_a_line_and_the_last_one_counts(tmp_path):
    path = tmp_path / "labels.csv"
    ledger = Ledger(path)
    ledger.add(Label("a", "safe", "ada", "first, with “commas”,\nand lines"))
    ledger.add(Label("b", "unsafe", "ada"))
    ledger.add(Label("a", "unsafe", "bob"))
    ledger.add(Label("a", "unsure", "ada"))
    assert [(r["episode_id"], r["label"], r["reviewer"]) for r in rows(path)] == [
        ("a", "safe", "ada"), ("b", "unsafe", "ada"), ("a", "unsafe", "bob"), ("a", "unsure", "ada"),
    ]  # fmt: skip
    assert rows(path)[0]["note"] == "first, with “commas”,\nand lines"
    again = Ledger(path)
    assert {name: label.label for name, label in again.of("ada").items()} == {
        "a": "unsure",
        "b": "unsafe",
    }
    assert again.of("bob")["a"].label == "unsafe"
    assert again.reviewers == ["ada", "bob"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("episode_id,label\na,safe\n", "lacks the column reviewer"),
        ("episode_id,label,reviewer\na,perhaps,ada\n", "'perhaps'"),
    ],
)
def test_a_file_that_is_something_else_is_refused(tmp_path, text, said):
    path = tmp_path / "labels.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        Ledger(path)
    assert path.read_text() == text


def test_two_that_write_at_once_lose_nothing(tmp_path):
    path = tmp_path / "labels.csv"
    ledgers = [Ledger(path), Ledger(path)]
    ledgers[0].add(Label("start", "safe", "ada"))

    def write(ledger, who):
        for i in range(40):
            ledger.add(Label(f"{i}", "safe", who, "n" * 300))

    threads = [threading.Thread(target=write, args=(x, f"r{i}")) for i, x in enumerate(ledgers * 2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(rows(path)) == 161
    assert {len(Ledger(path).of(f"r{i}")) for i in range(4)} == {40}


KILLED = """
import sys
from pathlib import Path
from safestage_eval.label.ledger import Ledger
from safestage_eval.metrics.labels import Label
ledger = Ledger(Path(sys.argv[1]))
for i in range(100_000):
    ledger.add(Label(f"episode-{i}", "unsafe", "ada", "note"))
    print(i, flush=True)
"""


def test_a_killed_process_loses_nothing_that_was_answered(tmp_path):
    path = tmp_path / "labels.csv"
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path)], stdout=subprocess.PIPE, text=True
    ) as process:
        last = -1
        while last < 25:
            last = int(process.stdout.readline())
        process.send_signal(signal.SIGKILL)
        last = int(([str(last), *process.stdout.read().split()])[-1])
    assert set(Ledger(path).of("ada")) >= {f"episode-{i}" for i in range(last + 1)}
    assert all(row["note"] == "note" for row in rows(path))
