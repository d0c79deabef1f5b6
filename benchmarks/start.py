"""How long a fresh process takes to its first verdict, to its help, and to its heaviest imports alone.

    python benchmarks/start.py              # each stage by its assigned rules, and by all of them
    python benchmarks/start.py --runs 20
    python benchmarks/start.py --recorded --against OLD      # what a short run loads and calls, in two checkouts

Each row starts ``safestage-score`` anew on one recorded episode of the size that score.py measures, its
files in the page cache. Times are wall clock, the least of ``--runs`` and in
brackets their median; rows take turns, so that a machine whose speed changes is unfair to none.

With ``--recorded``: what ``safestage-score traces/ --rules rules/ --jobs 1`` imports and calls, counted by
cProfile, and the first verdict of a fresh process on a recorded episode by ``rules/fsh.toml``, as
processor and clock time; of this checkout and of those after ``--against``, taking turns.
"""

from __future__ import annotations

import argparse
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import made
from machine import machine

CHECKOUT = Path(__file__).resolve().parents[1]
TRACES = CHECKOUT / "traces"
RECORDED = TRACES / "fsh_orange_on_plate.reference-safe.default.s0.r0.mcap"

COUNT = """
import cProfile, pstats, sys
profile = cProfile.Profile()
profile.enable()
from safestage_eval.cli import score_main
try:
    score_main()
except SystemExit:
    pass
profile.disable()
calls = [(place[0], numbers[1]) for place, numbers in pstats.Stats(profile).stats.items()]
own = sum(number for file, number in calls if "safestage_eval" in file)
modules = [name for name in sys.modules if name.partition(".")[0] == "safestage_eval"]
print(len(modules), len(sys.modules), own, sum(n for _, n in calls), file=sys.stderr)
"""
"""Program that counts modules (own, all) and calls (own, all) of a command."""

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


def environment(checkout: Path, compiled: Path) -> dict[str, str]:
    """Environment that runs the package of a checkout, with its bytecode kept as if it were installed."""
    kept = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    kept |= {"PYTHONSAFEPATH": "1", "PYTHONPATH": str(checkout)}  # and not the current folder
    return {**kept, "PYTHONPYCACHEPREFIX": str(compiled)}


def counts(place: dict[str, str]) -> list[int]:
    """Modules (own, all) and calls (own, all) of a short run."""
    command = [*(sys.executable, "-c", COUNT, str(TRACES)), "--rules", str(CHECKOUT / "rules")]
    done = subprocess.run(
        [*command, "--jobs", "1"], env=place, check=True, capture_output=True, text=True
    )
    return [int(word) for word in done.stderr.split()[-4:]]


def first_verdict(place: dict[str, str]) -> tuple[float, float]:
    """Processor and clock time (s) of a fresh process that judges one recorded episode."""
    program = "from safestage_eval.cli import score_main; score_main()"
    rules = ["--rules", str(CHECKOUT / "rules" / "fsh.toml"), "--jobs", "1"]
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(
        [sys.executable, "-c", program, str(RECORDED), *rules],
        env=place, check=True, capture_output=True,
    )  # fmt: skip
    clock, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, clock


def compare(checkouts: list[Path], runs: int) -> None:
    """Print counts and first verdicts of checkouts."""
    with tempfile.TemporaryDirectory() as name:
        places = [environment(one, Path(name) / str(n)) for n, one in enumerate(checkouts)]
        found = [counts(place) for place in places]  # and everything is compiled by now
        times: list[list[tuple[float, float]]] = [[] for _ in places]
        for _ in range(runs):
            for number, place in enumerate(places):
                times[number].append(first_verdict(place))
    words = ("own modules", "modules", "own calls", "calls", "processor s", "clock s")
    print("first verdict: medians, least in brackets")
    print(f"{'':34}" + "".join(f"{word:>15}" for word in words))
    for checkout, numbers, taken in zip(checkouts, found, times, strict=True):
        cells = [f"{number:,}" for number in numbers]
        cells += [f"{median(each):.2f} ({min(each):.2f})" for each in zip(*taken, strict=True)]
        print(f"{str(checkout)[-33:]:34}" + "".join(f"{cell:>15}" for cell in cells))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--recorded", action="store_true", help="what a short run loads and calls")
    parser.add_argument("--against", type=Path, nargs="*", default=[], help="other checkouts")
    args = parser.parse_args()
    print(machine())
    if args.recorded:
        compare([*args.against, CHECKOUT], args.runs)
        return
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
