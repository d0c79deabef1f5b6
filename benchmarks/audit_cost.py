"""Compare the processor time of the audit between this checkout and another.

    python benchmarks/audit_cost.py FOLDER --against ../before --every 12

Two processes, one per checkout, take turns in auditing the same episodes. Each episode counts with the least
of its ``--runs`` times, which other work on the machine disturbs least.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

BLOCK = 6
"""Episodes that are taken in a row: recorded references of a task, which share their scene."""


def serve(folder: str) -> None:
    """Audit the episodes whose numbers come on stdin; answer with the processor time (s) of each."""
    from safestage_eval._process import heap
    from safestage_eval._process.precompile import compile_kernels
    from safestage_eval.audit import choose
    from safestage_eval.audit.audit_episode import audit_episode
    from safestage_eval.formats import discover
    from safestage_eval.rules import builtin_names
    from safestage_eval.run.settings import load_settings

    heap.keep()
    compile_kernels()
    refs, checks, rules = discover(folder), choose(), load_settings(builtin_names()).rule_set
    print(len(refs), flush=True)
    for line in sys.stdin:
        start = time.process_time()
        audit_episode(refs[int(line)], checks, rules)
        print(time.process_time() - start, flush=True)


def started(checkout: Path, folder: Path) -> subprocess.Popen[str]:
    """A process of a checkout that audits."""
    return subprocess.Popen(
        [sys.executable, str(Path(__file__).resolve()), str(folder), "--serve"],
        cwd=checkout, env=dict(os.environ, PYTHONPATH=str(checkout)),
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip


def asked(process: subprocess.Popen[str], number: int) -> float:
    """Processor time (s) of one episode."""
    assert process.stdin is not None and process.stdout is not None
    process.stdin.write(f"{number}\n")
    process.stdin.flush()
    return float(process.stdout.readline())


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--against", type=Path, help="Another checkout.")
    parser.add_argument("--every", type=int, default=1, help="Of blocks of six episodes.")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.serve:
        serve(str(args.folder))
        return
    here = Path(__file__).resolve().parents[1]
    checkouts = [here] if args.against is None else [args.against.resolve(), here]
    processes = [started(checkout, args.folder.resolve()) for checkout in checkouts]
    count = min(int(process.stdout.readline()) for process in processes if process.stdout)
    chosen = [n for n in range(count) if n // BLOCK % args.every == 0]
    least = [dict.fromkeys(chosen, float("inf")) for _ in processes]
    for _ in range(args.runs):
        for number in chosen:
            for times, process in zip(least, processes, strict=True):
                times[number] = min(times[number], asked(process, number))
    for checkout, times in zip(checkouts, least, strict=True):
        print(f"{checkout}: {1e3 * sum(times.values()) / len(times):.1f} ms an episode")
    for process in processes:
        process.communicate()


if __name__ == "__main__":
    main()
