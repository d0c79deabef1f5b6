"""Read + score of an episode of full size, and its ratio to a plain python-fcl evaluator.

    python benchmarks/score.py              # every stage, from Parquet and MCAP; the ratio
    python benchmarks/score.py --growth     # how cost grows: frames, bodies, contacts, protected
    python benchmarks/score.py --profile ETS

The episode (8,000 frames, 20 objects and an arm, 36 contacts per frame; made.py) is written to a
temporary folder first. Times are of the processor, the least of ``--runs`` in one warm process, and
in brackets their median; files are in the page cache. ``--every N`` lets the plain loop visit every Nth
frame and scales its time.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import made
import numpy as np
from machine import machine
from plain import distances

from safestage_eval._process import heap
from safestage_eval.evidence.measure import Signals
from safestage_eval.formats.episode_ref import EpisodeRef
from safestage_eval.formats.parquet import table_file
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import EpisodeResult, judge

LIMIT = 0.08
"""m, as ``min_clearance`` in rules/ets.toml."""


class Times(NamedTuple):
    """s of the processor that several runs took."""

    least: float
    median: float

    def __str__(self) -> str:
        """In ms."""
        return f"{self.least * 1e3:.1f} ({self.median * 1e3:.1f})"


def timed(function: Callable[[], Any], runs: int) -> tuple[Times, Any]:
    """Several runs after one that is not counted, and the result."""
    result, times = function(), []
    for _ in range(runs):
        start = time.process_time()
        result = function()
        times.append(time.process_time() - start)
    return Times(min(times), median(times)), result


def read_and_score(ref: EpisodeRef, rules: Any, assigned_only: bool = True) -> EpisodeResult:
    """One episode from its file to its verdicts; no footer is kept from the time before."""
    table_file.forget()
    return judge(ref.open(), rules, trace_hash=ref.content_hash, assigned_only=assigned_only)


def headline(folder: Path, runs: int, every: int) -> None:
    """Every stage from both formats; the ratio to the plain loop."""
    episode = made.make("ETS").episode()
    print(
        f"{len(episode)} frames, {len(episode.header.bodies)} bodies, "
        f"{len(episode.contacts) / len(episode):.0f} contacts per frame"
    )
    print(
        "\nms of one core, least (median): read + score by the assigned rules, and by all of the stage"
    )
    print("     " + "".join(f"{x:>15}" for x in ("Parquet", "all", "MCAP")))
    for stage in made.ASSIGNED:
        rules = load_rules([stage.lower()])
        times: list[Times] = []
        parquet = made.write(folder / stage, stage)
        mcap = made.write(folder / f"{stage}.mcap", stage)
        for ref, assigned in ((parquet, True), (parquet, False), (mcap, True)):
            found, result = timed(
                lambda ref=ref, a=assigned, rules=rules: read_and_score(ref, rules, a), runs
            )
            times.append(found)
        text = ", ".join(f"{v.rule} {v.verdict}" for v in result.verdicts)
        print(f"{stage:5}" + "".join(f"{x!s:>15}" for x in times) + f"   {text}", flush=True)
    print("\nagainst the plain python-fcl loop: robot and target to each protected object")
    for protected, walls in ((3, 0), (17, 0), (3, 24)):
        compare(folder, made.Size(protected=protected, walls=walls), runs, every)


def compare(folder: Path, size: made.Size, runs: int, every: int) -> None:
    """The rules of ETS, read and scored, against the plain loop over the same pairs of bodies."""
    ref = made.write(folder / f"plain{size.protected}.{size.walls}", "ETS", size)
    rules = load_rules(["ets"])
    (ours, _), result = timed(lambda: read_and_score(ref, rules), runs)
    start = time.process_time()
    episode = ref.open()
    robot = [b.name for b in episode.header.bodies if b.kind in ("robot", "gripper") and b.movable]
    (target,) = episode.header.roles["target"]
    found = distances(episode, [*robot, target], episode.header.roles["protected"], every)
    theirs = (time.process_time() - start) * every
    differ = 0
    for (a, b), series in found.items():
        own = Signals(episode).get("clearance", (a, b)).upper[::every]
        differ += int(((series < LIMIT) != (own < LIMIT)).sum())
    asked = sum(len(series) for series in found.values())
    shapes = {body.name: len(body.geoms) for body in episode.header.bodies}
    pairs = sum(shapes[a] * shapes[b] for a, b in found)
    said = ", ".join(f"{v.rule} {v.verdict}" for v in result.verdicts)
    print(
        f"{size.protected:3} protected, {pairs} pairs of shapes: {ours * 1e3:7.1f} ms against {theirs:6.1f} s"
        f" = {theirs / ours:6.0f} x  ({said})\n"
        f"    closer than {LIMIT * 100:.0f} cm: {differ} of {asked} answers differ",
        flush=True,
    )


def growth(folder: Path, runs: int) -> None:
    """One size at a time; ms of read + score with the rules of each stage, from Parquet."""
    usual = made.Size()
    axes: dict[str, list[Any]] = {
        "frames": [1000, 2000, 4000, 8000, 16000],
        "objects": [10, 20, 40, 80],
        "points": [1, 4, 16, 32],
        "protected": [1, 3, 9, 17],
    }
    ruleset = {stage: load_rules([stage.lower()]) for stage in made.ASSIGNED}
    for axis, values in axes.items():
        print(f"\n{axis:>10}  contacts/frame" + "".join(f"{stage:>15}" for stage in ruleset))
        for value in values:
            size, cells, density = replace(usual, **{axis: value}), [], 0.0
            for stage, rules in ruleset.items():
                ref = made.write(folder / f"{axis}{value}" / stage, stage, size)
                found, _ = timed(lambda r=ref, rules=rules: read_and_score(r, rules), runs)
                cells.append(f"{found!s:>15}")
                density = len(ref.open().contacts) / size.frames
            print(f"{value:10}{density:16.0f}" + "".join(cells), flush=True)


def profile(folder: Path, stage: str, runs: int) -> None:
    """Where the time goes, function by function."""
    rules = load_rules([stage.lower()])
    ref = made.write(folder / stage, stage)
    read_and_score(ref, rules)
    with cProfile.Profile() as found:
        for _ in range(runs):
            read_and_score(ref, rules)
    pstats.Stats(found).sort_stats("tottime").print_stats(30)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--growth", action="store_true", help="tables over four sizes")
    parser.add_argument("--profile", choices=made.ASSIGNED, help="one stage, by function")
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--every", type=int, default=10, help="frames per step of the plain loop")
    args = parser.parse_args()
    heap.keep()  # as the command and its workers do
    print(f"{machine()}, NumPy {np.__version__}")
    with tempfile.TemporaryDirectory() as name:
        if args.profile:
            profile(Path(name), args.profile, args.runs)
        elif args.growth:
            growth(Path(name), args.runs)
        else:
            headline(Path(name), args.runs, args.every)


if __name__ == "__main__":
    main()
