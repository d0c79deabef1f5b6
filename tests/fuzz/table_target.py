"""Hostile tables of results, outcomes and labels for the commands that count them."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from random import Random
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from click.testing import CliRunner
from damage import damaged
from outcome import Outcome
from seeds import episodes, rules
from strange import altered, strange

from safestage_eval.cli import group
from safestage_eval.errors import InputError
from safestage_eval.formats import save
from safestage_eval.metrics.read_rows import read_rows
from safestage_eval.report import render
from safestage_eval.run.score_episode import score_episode
from safestage_eval.run.scores import Scores

OUTCOMES = [
    {"task": task, "stage": stage, "policy": policy, "prompt": "default", "seed": seed,
     "rollout": 0, "success": seed == 0, "violation": policy == "b"}
    for task, stage in (("x", "ISH"), ("y", "ETS")) for policy in "ab" for seed in (0, 1)
]  # fmt: skip
LABELS = [
    {"episode_id": name, "label": label, "reviewer": "ann", "note": "", "labelled_at": "2026-01-01"}
    for name, label in (("carried", "unsafe"), ("toppled", "safe"))
]


class Tables:
    """One table, read by the command that is for such tables."""

    name = "result, outcome and label tables"
    read_by = ("pyarrow",)

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        results = []
        for episode in episodes():
            ref = save(episode, folder / f"{episode.header.episode_id}.mcap")
            results.append(score_episode(ref, rules()))
        lines = render(Scores(tuple(results)), "jsonl").splitlines()
        self.results = [json.loads(line) for line in lines]
        self.whole = folder / "whole.jsonl"
        self.whole.write_text("\n".join(lines))
        self.labels = folder / "labels.csv"
        self.labels.write_bytes(_csv(LABELS))

    def run(self, rng: Random) -> Outcome:
        """One input."""
        seed = rng.choice(("results", "results", "outcomes", "labels"))
        rows = {"results": self.results, "outcomes": OUTCOMES, "labels": LABELS}[seed]
        path, what = self.made(rng, rows)
        commands: list[tuple[Any, ...]] = [("aggregate", path), ("compare", path, self.whole)]
        if seed == "labels":
            commands = [("agreement", path, "--results", self.whole)]
        elif seed == "results":
            commands.append(("agreement", self.labels, "--results", path))
            if rng.random() < 0.05:
                commands = [("report", path, "--output", self.folder / "report.html")]
        asked = [str(part) for part in rng.choice(commands)]
        done = CliRunner().invoke(group, asked)
        what = f"{asked[0]}, {seed}: {what}"
        if done.exception is None or isinstance(done.exception, SystemExit):
            if done.exit_code:
                return Outcome("problem", what, done.output[-300:])
            return self.held(path, rows, asked, done.output, what)
        if isinstance(done.exception, InputError):
            return Outcome("problem", what, str(done.exception)[:300])
        place = done.exc_info[2]
        while place.tb_next is not None:
            place = place.tb_next
        where = f"{place.tb_frame.f_code.co_filename}:{place.tb_lineno}"
        return Outcome(
            "unforeseen", what, f"{type(done.exception).__name__}: {done.exception} {where}"
        )

    def held(
        self, path: Path, rows: list[dict[str, Any]], asked: list[str], output: str, what: str
    ) -> Outcome:
        """Compare the output with the sound table's, where the rows are its rows."""
        try:
            found = repr(read_rows(path))
        except InputError:  # in columns that the command does not read
            return Outcome("lie", what)
        path.write_bytes(_FORMS[path.suffix[1:]](rows))
        if found != repr(read_rows(path)):
            return Outcome("lie", what)
        again = CliRunner().invoke(group, asked).output
        return Outcome("same" if again == output else "changed", what, "the same rows")

    def made(self, rng: Random, rows: list[dict[str, Any]]) -> tuple[Path, str]:
        """The file, and what was done."""
        rows, what, act = [dict(row) for row in rows], "bytes", rng.random()
        if act < 0.4:
            table, what = altered(rng, rows)
            rows = table if isinstance(table, list) else [table]
        elif act < 0.6:
            for row in rows:
                key = rng.choice(list(row))
                row[key] = strange(rng, row[key])
            what = "a cell of every row"
        form = rng.choice(("json", "jsonl", "csv", "parquet"))
        path = self.folder / f"input.{form}"
        try:
            path.write_bytes(_FORMS[form](rows))
        except (ValueError, TypeError, AttributeError, OverflowError, pa.ArrowException):
            path = self.folder / "input.json"
            path.write_bytes(_FORMS["json"](rows))
        if what == "bytes":
            data, what = damaged(rng, path.read_bytes(), [0, 1, 10])
            path.write_bytes(data)
        return path, f"{path.suffix}, {what}"


def _csv(rows: list[dict[str, Any]]) -> bytes:
    out = io.StringIO()
    names = list(dict.fromkeys(key for row in rows for key in row))
    writer = csv.DictWriter(out, names)
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue().encode("utf-8", "replace")


def _parquet(rows: list[dict[str, Any]]) -> bytes:
    sink = pa.BufferOutputStream()
    pq.write_table(pa.Table.from_pylist(rows), sink)
    return sink.getvalue().to_pybytes()


_FORMS = {
    "json": lambda rows: json.dumps(rows).encode(),
    "jsonl": lambda rows: "\n".join(map(json.dumps, rows)).encode(),
    "csv": _csv,
    "parquet": _parquet,
}
