"""Which rollouts of a campaign are read blindly: spread over tasks and policies, half of them violations.

    python benchmarks/blind_study.py ROWS -o list.csv [--count 240]

From the results of ``safestage score`` (Parquet): of each stage equally many, half of them violations, spread over tasks first,
then over policies and prompts. What needs a force to be judged is left out: pictures show none. The list is in a mixed order
and tells no verdict. ``make blind-study`` and ``make learned-sheets`` draw such lists.
"""

from __future__ import annotations

import argparse
import hashlib
from collections import Counter
from pathlib import Path
from typing import Any

import polars as pl

from safestage_eval.metrics.outcome_rows import FOR_LABELS, read_outcomes
from safestage_eval.rules import builtin_names, load_rules
from safestage_eval.rules.uses import calls

FORCES = {"peak_force", "total_force", "impulse", "contact_force"}
"""Signals whose value decides, and which nobody sees."""
COLUMNS = ["episode_id", "stage", "task", "policy", "prompt"]


def candidates(rows: Path) -> list[dict[str, Any]]:
    """Decided rollouts by no rule that asks for a force: ``COLUMNS`` and ``violation``."""
    verdicts = {
        str(one.episode_id): one.violation for one in read_outcomes([rows], wanted=FOR_LABELS)[""]
    }
    rules = load_rules(builtin_names()).rules
    unseen = [code for code in rules if FORCES & {call.name for call in calls(rules[code])}]
    table = pl.read_parquet(rows).filter(pl.col("assigned"))
    hidden = set(table.filter(pl.col("rule").is_in(unseen))["episode_id"])
    return [
        {**row, "violation": verdicts[row["episode_id"]]}
        for row in table.select(COLUMNS).unique().sort("episode_id").to_dicts()
        if row["episode_id"] not in hidden and verdicts[row["episode_id"]] is not None
    ]


def chosen(rows: list[dict[str, Any]], count: int, seed: int) -> list[dict[str, Any]]:
    """So many of them, fewer where there are fewer; another seed chooses others."""

    def rank(what: str, row: dict[str, Any]) -> bytes:
        return hashlib.sha256(f"{seed}\n{what}\n{row['episode_id']}".encode()).digest()

    found: list[dict[str, Any]] = []
    stages = sorted({row["stage"] for row in rows})
    room = count // len(stages)
    for stage in stages:
        broken, kept = (
            [row for row in rows if row["stage"] == stage and row["violation"] is verdict]
            for verdict in (True, False)
        )
        half = min(room - min(room // 2, len(kept)), len(broken))
        for cell, share in ((broken, half), (kept, min(room - half, len(kept)))):
            left = sorted(cell, key=lambda row: rank("episode", row))
            met: Counter[str] = Counter()
            for _ in range(share):
                one = min(left, key=lambda r: (met[r["task"]], met[f"{r['policy']} {r['prompt']}"]))
                left.remove(one)
                met.update([one["task"], f"{one['policy']} {one['prompt']}"])
                found.append(one)
    return sorted(found, key=lambda row: rank("order", row))


def main() -> None:
    """Write the list, and print what is in it."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("rows", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--count", type=int, default=240)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    sample = chosen(candidates(options.rows), options.count, options.seed)
    names = [row["episode_id"] for row in sample]
    options.output.write_text("\n".join(["episode_id", *names, ""]), "utf-8")
    for (stage, violation), many in sorted(
        Counter((row["stage"], row["violation"]) for row in sample).items()
    ):
        print(f"{stage}, {'violation' if violation else 'pass'}: {many} rollouts")


if __name__ == "__main__":
    main()
