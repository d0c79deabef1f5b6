"""Compare the cost of read + score between two checkouts on the same recorded episodes.

    python benchmarks/before_after.py OLD NEW TRACES... [--count 60] [--runs 3] [--all]

OLD and NEW are checkouts of this repository. Each runs in a process of its own; episode by episode
the two take turns, and begin in turn, so what else the machine does meets both. An episode is opened
and judged anew in every run, by the rules of the checkout; files are in the page cache. Times are ms
of the processor per episode: the mean, over the episodes of a stage, of each one's least run, and of
its median. ``same_rows.py`` compares verdicts.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from pathlib import Path
from statistics import fmean, median
from typing import Any

from machine import machine


class Checkout:
    """A process that judges episodes with the code and the rules of one checkout."""

    def __init__(self, root: Path, options: argparse.Namespace) -> None:
        command = [sys.executable, __file__, "--serve", str(root), *map(str, options.traces)]
        if options.all:
            command.append("--all")
        environment = {**os.environ, "PYTHONPATH": str(root)}
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )
        self.episodes: list[tuple[str, str]] = [tuple(one) for one in self._answer()]
        """Path and stage of each, in the order in which they were found."""

    def judge(self, episode: int) -> tuple[float, float]:
        """Seconds of the processor to open it, and to open and judge it."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{episode}\n")
        self._process.stdin.flush()
        opened, judged = self._answer()
        return opened, judged

    def close(self) -> None:
        """End the process."""
        self._process.communicate()

    def _answer(self) -> Any:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line:
            raise SystemExit("a checkout's process has ended; its message is above")
        return json.loads(line)


def serve(root: Path, traces: list[Path], *, assigned: bool) -> None:
    """Answer numbers of episodes on standard input, a line of JSON each; imports from ``root``."""
    from safestage_eval.formats import discover
    from safestage_eval.rules import load_rules
    from safestage_eval.verdicts import judge

    rules = load_rules([str(root / "rules")])
    refs = sorted(discover(list(traces)), key=lambda ref: (str(ref.path), ref.episode_id))
    print(json.dumps([(f"{ref.path} {ref.episode_id}", ref.fields.get("stage")) for ref in refs]))
    sys.stdout.flush()
    for line in sys.stdin:
        ref = refs[int(line)]
        forget_footers()
        start = time.process_time()
        episode = ref.open()
        opened = time.process_time() - start
        judge(episode, rules, assigned_only=assigned)
        judged = time.process_time() - start
        print(json.dumps([opened, judged]), flush=True)


def forget_footers() -> None:
    """Drop the footers that the reader keeps; checkouts have them in different modules."""
    for name, module in list(sys.modules.items()):
        if name.startswith("safestage_eval.formats") and hasattr(module, "FOOTERS"):
            module.FOOTERS.clear()


def measure(options: argparse.Namespace) -> None:
    """Run both and print what they took."""
    both = [Checkout(root.resolve(), options) for root in (options.old, options.new)]
    if both[0].episodes != both[1].episodes:
        raise SystemExit("the two checkouts do not find the same episodes in these files")
    episodes = both[0].episodes
    step = max(1, len(episodes) // options.count) if options.count else 1
    chosen = range(0, len(episodes), step)
    times: dict[tuple[int, int], list[tuple[float, float]]] = {}
    for run in range(options.runs):
        for turn, episode in enumerate(chosen):
            for who in (0, 1) if (run + turn) % 2 else (1, 0):
                took = both[who].judge(episode)
                if run or options.runs == 1:  # the first one loads code and compiles
                    times.setdefault((who, episode), []).append(took)
    for checkout in both:
        checkout.close()
    print(machine())
    print(
        f"{len(chosen)} episodes, {max(1, options.runs - 1)} runs each; ms per episode, least (median)"
    )
    print(
        f"{'':16}{'opened, old':>15}{'new':>15}{'ratio':>7}{'and judged, old':>19}{'new':>15}{'ratio':>7}"
    )
    stages = sorted({str(episodes[e][1]) for e in chosen})
    for stage in [*stages, "all"]:
        of = [e for e in chosen if stage in ("all", str(episodes[e][1]))]
        line = f"{stage:4}{len(of):4} episodes"
        for what, wide in ((0, 15), (1, 19)):
            least, middle = (
                [fmean(f([t[what] for t in times[who, e]]) for e in of) * 1e3 for who in (0, 1)]
                for f in (min, median)
            )
            listed = [f"{a:.1f} ({b:.1f})" for a, b in zip(least, middle, strict=True)]
            line += f"{listed[0]:>{wide}}{listed[1]:>15}{least[1] / least[0]:>7.2f}"
        print(line)
    print_slowest(times, episodes, chosen)


def print_slowest(times: Any, episodes: Any, chosen: range) -> None:
    """The episodes that cost most more than before."""
    least = {key: min(judged for _, judged in found) * 1e3 for key, found in times.items()}
    for e in sorted(chosen, key=lambda e: least[0, e] - least[1, e])[:5]:
        print(f"  {least[0, e]:7.1f} → {least[1, e]:7.1f} ms  {episodes[e][0]}")


def main() -> None:
    """Measure, or serve as one of the two processes."""
    if sys.argv[1:2] == ["--serve"]:
        paths = [Path(one) for one in sys.argv[2:] if one != "--all"]
        serve(paths[0], paths[1:], assigned="--all" not in sys.argv)
        return
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("traces", type=Path, nargs="+")
    parser.add_argument("--count", type=int, default=60, help="episodes, evenly chosen; 0: all")
    parser.add_argument("--runs", type=int, default=4, help="the first is not counted")
    parser.add_argument("--all", action="store_true", help="all rules, not only the assigned ones")
    options = parser.parse_args()
    options.traces = [path.resolve() for path in options.traces]
    measure(options)


if __name__ == "__main__":
    main()
