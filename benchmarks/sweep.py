"""A sweep over many thresholds of one rule, against one scoring run of the same episodes.

    python benchmarks/sweep.py [--traces traces] [--rules ets] [--param min_clearance]
                               [--from "1 cm"] [--to "20 cm"] [--steps 200] [--runs 5]

Both read every episode and judge it with the same rule file, in one process, one after the other.
The sweep's verdicts are compared with those of scoring at every tenth value.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from machine import machine

from safestage_eval.formats import discover
from safestage_eval.metrics import outcomes, rates
from safestage_eval.rules import load_rules
from safestage_eval.run.score_many import score_many, score_paths
from safestage_eval.whatif.sweep import sweep
from safestage_eval.whatif.swept_values import between, text_of


def timed(function: Callable[[], Any], runs: int) -> tuple[float, Any]:
    """Median wall time (s) of several runs, and the last result."""
    times, result = [], None
    for _ in range(runs):
        start = time.perf_counter()
        result = function()
        times.append(time.perf_counter() - start)
    return statistics.median(times), result


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--traces", type=Path, default=Path(__file__).parent.parent / "traces")
    parser.add_argument("--rules", default="ets")
    parser.add_argument("--param", default="min_clearance")
    parser.add_argument("--from", dest="first", default="1 cm")
    parser.add_argument("--to", dest="last", default="20 cm")
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--runs", type=int, default=5)
    args = parser.parse_args()
    specs, refs = [args.rules], discover([args.traces])
    values = between(load_rules(specs), args.param, args.first, args.last, args.steps)
    score_many(refs, specs, jobs=1)  # compile
    score, _ = timed(lambda: score_many(refs, specs, jobs=1), args.runs)
    swept, found = timed(lambda: sweep(refs, specs, args.param, values, jobs=1), args.runs)
    print(machine())
    print(f"one scoring run, {len(refs)} episodes, rules {args.rules}: {score * 1e3:8.1f} ms")
    print(f"{len(values)} values of {args.param}:{swept * 1e3:21.1f} ms")
    print(f"ratio: {swept / score:.2f}")
    (curve,) = found.curves().values()
    kept = set(found.segments["episode_id"])
    same = 0
    for i in range(0, len(values), 10):
        scores = score_paths(
            [args.traces], specs, overrides={args.param: text_of(values[i])}, jobs=1
        )
        cell = rates(outcomes(r for r in scores.results if r.episode_id in kept))
        if cell != curve[i]:
            raise SystemExit(f"{args.param} = {text_of(values[i])}: the sweep says something else")
        same += 1
    print(f"same rates as scoring at {same} of {same} values compared")


if __name__ == "__main__":
    main()
