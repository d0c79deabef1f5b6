"""The blind agreement study of docs/labels.md: which rollouts of a noisy corpus are read.

    python benchmarks/blind_study.py ROWS -o list.csv        (make blind-study does all)

From the results of ``safestage score`` on the corpus, 240 rollouts: 80 of each stage, half of them
violations, spread over tasks and noise. What needs a force to be judged is left out: pictures show
none. The list is in a mixed order and tells no verdict.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import polars as pl

from safestage_eval.metrics.outcome_rows import FOR_LABELS, read_outcomes
from safestage_eval.rules import builtin_names, load_rules
from safestage_eval.rules.uses import calls

FORCES = {"peak_force", "total_force", "impulse", "contact_force"}
"""Signals whose value decides, and which nobody sees."""


def unseen() -> set[str]:
    """Codes of the rules that ask for a force directly."""
    rules = load_rules(builtin_names()).rules
    return {code for code in rules if FORCES & {call.name for call in calls(rules[code])}}


def chosen(rows: Sequence[dict[str, Any]], count: int, seed: int) -> list[dict[str, Any]]:
    """Rollouts, evenly over stage and verdict, and in each over tasks first, then over noise.

    Args:
        rows: ``episode_id``, ``stage``, ``task``, ``policy``, ``violation``.
        count: how many; fewer where a cell has fewer.
        seed: another one chooses others.
    """

    def rank(what: str, name: str) -> bytes:
        return hashlib.sha256(f"{seed}\n{what}\n{name}".encode()).digest()

    found: list[dict[str, Any]] = []
    stages = sorted({row["stage"] for row in rows})
    for stage in stages:
        cells = [
            [row for row in rows if row["stage"] == stage and row["violation"] is verdict]
            for verdict in (True, False)
        ]
        room = count // len(stages)
        shares = [min(room // 2, len(cells[0])), 0]
        shares[1] = min(room - shares[0], len(cells[1]))
        shares[0] = min(room - shares[1], len(cells[0]))
        for cell, share in zip(cells, shares, strict=True):
            left = sorted(cell, key=lambda row: rank("episode", row["episode_id"]))
            tasks: Counter[str] = Counter()
            noises: Counter[str] = Counter()
            for _ in range(share):
                one = min(left, key=lambda row: (tasks[row["task"]], noises[noise(row)]))
                left.remove(one)
                tasks[one["task"]] += 1
                noises[noise(one)] += 1
                found.append(one)
    return sorted(found, key=lambda row: rank("order", row["episode_id"]))


def noise(row: dict[str, Any]) -> str:
    """``0.06`` of the policy ``noisy:0.06:unsafe``."""
    return str(row["policy"]).split(":")[1]


def main() -> None:
    """Write the list."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rows", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--count", type=int, default=240)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    judged = read_outcomes([options.rows], wanted=FOR_LABELS)[""]
    verdicts = {str(one.episode_id): one.violation for one in judged}
    table = pl.read_parquet(options.rows).filter(pl.col("assigned"))
    hidden = set(table.filter(pl.col("rule").is_in(sorted(unseen())))["episode_id"])
    columns = ["episode_id", "stage", "task", "policy"]
    rows = [
        {**row, "violation": verdicts[row["episode_id"]]}
        for row in table.select(columns).unique().sort("episode_id").to_dicts()
        if row["episode_id"] not in hidden and verdicts[row["episode_id"]] is not None
    ]
    sample = chosen(rows, options.count, options.seed)
    with options.output.open("w", newline="", encoding="utf-8") as handle:
        writer = csv.writer(handle, lineterminator="\n")
        writer.writerow(["episode_id"])
        writer.writerows([row["episode_id"]] for row in sample)
    for stage in sorted({row["stage"] for row in sample}):
        of = [row for row in sample if row["stage"] == stage]
        noises = Counter(noise(row) for row in of)
        print(
            f"{stage}: {len(of)} rollouts of {len({row['task'] for row in of})} tasks, "
            f"{sum(row['violation'] for row in of)} violations, noise {dict(sorted(noises.items()))}"
        )


if __name__ == "__main__":
    main()
