"""How long a fresh process takes to its first verdict, to its help, and to its heaviest imports alone.

    python benchmarks/start.py              # each stage by its assigned rules, and by all of them
    python benchmarks/start.py --runs 20

Each row starts ``safestage-score`` anew on one recorded episode of the size that score.py measures, its
files in the page cache. Times are wall clock, the least of ``--runs`` and in
brackets their median; rows take turns, so that a machine whose speed changes is unfair to none.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import made
from machine import machine

SCORE = shutil.which("safestage-score", path=str(Path(sys.executable).parent)) or "safestage-score"


def took(command: list[str]) -> float:
    """Time (s) that one process took; raises if it failed."""
    start = time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    return time.perf_counter() - start


def commands(folder: Path) -> dict[str, list[str]]:
    """Commands to start, by the name of their row."""
    found = {
        "python -c pass": [sys.executable, "-c", "pass"],
        "import scipy.optimize, pyarrow.parquet, pydantic": [
            *(sys.executable, "-c", "import scipy.optimize, pyarrow.parquet, pydantic")
        ],
        "safestage-score --help": [SCORE, "--help"],
    }
    for stage in made.ASSIGNED:
        where = folder / stage
        made.write(where, stage)
        score = [SCORE, str(where), "--rules", stage.lower(), "--jobs", "1"]
        found[f"{stage}, assigned rules"] = [*score, "--assigned"]
        found[f"{stage}, all its rules"] = score
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=10)
    args = parser.parse_args()
    print(machine())
    with tempfile.TemporaryDirectory() as name:
        asked = commands(Path(name))
        for command in asked.values():
            took(command)
        times: dict[str, list[float]] = {row: [] for row in asked}
        for _ in range(args.runs):
            for row, command in asked.items():
                times[row].append(took(command))
    print("\ns of wall clock, least (median)")
    for row, found in times.items():
        print(f"{row:42}{min(found):7.2f} ({median(found):.2f})")


if __name__ == "__main__":
    main()
