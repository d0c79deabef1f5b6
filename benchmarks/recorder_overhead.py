"""Overhead of ``safestage-record``, as a share of the rollout without it, in one run.

    python benchmarks/recorder_overhead.py [ENVIRONMENT …]

Run it in the simulator's own environment, with ``recorder/`` on PYTHONPATH. The ways to record (none,
frames alone, every physics step) take turns, an episode of control steps at a time, on one
environment and with the same actions. Processor time of this process per control step, all that turns frames into
arrays and writes them while the episode runs included: the median over the turns, each compared with the mean of
the two turns of "nothing" around it. By how much those two differ is what can be measured. What begins and
ends an episode, its file included, is measured separately.
"""

from __future__ import annotations

import gc
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import safestage_record
from peer_envs import ENVIRONMENTS

TURNS, STEPS = 12, 400
NOTHING: dict[str, Any] = {}
WAYS: dict[str, dict[str, Any]] = {
    "frames": {"frame_dt": None, "substeps": False},
    "steps": {"frame_dt": None},
    "0.01 s": {"frame_dt": 0.01},
}


def roll(env: Any, draw: Any, path: Path, settings: dict[str, Any]) -> tuple[float, float]:
    """Return s of processor time of a control step, and of the episode's begin and end."""
    rng = np.random.default_rng(0)
    env.reset()
    actions = [draw(rng) for _ in range(STEPS)]
    recorder: Any = None
    before = time.process_time()
    if settings:
        recorder = safestage_record.find_backend.begin_recording(env, path, **settings)
    env.step(actions[0])
    if recorder is not None:
        recorder.step(actions[0])  # the first one begins the journal
    begun = time.process_time()
    for action in actions:
        env.step(action)
        if recorder is not None:
            recorder.step(action)
    if recorder is not None:
        recorder._flush()  # noqa: SLF001 - what a longer episode would do meanwhile
    ended = time.process_time()
    if recorder is not None:
        recorder.close()
    around = begun - before + time.process_time() - ended
    gc.collect()
    return (ended - begun) / STEPS, around


def measure(make: Any) -> tuple[float, float, dict[str, tuple[float, float, float]]]:
    """Return s of a control step, by what share two of them differ, and what each way adds to both.

    By way: its share of the control step, s of it, and s of an episode's begin and end; medians.
    """
    env, draw = make()
    plain: list[float] = []
    around: list[float] = []
    doubts: list[float] = []
    found: dict[str, list[tuple[float, float, float]]] = {name: [] for name in WAYS}
    gc.disable()
    with tempfile.TemporaryDirectory() as folder:
        roll(env, draw, Path(folder) / "first.zip", WAYS["steps"])
        last, _ = roll(env, draw, Path(), NOTHING)
        for turn in range(TURNS):
            for name in np.random.default_rng(turn).permutation(list(WAYS)):
                own, edges = roll(env, draw, Path(folder) / f"{turn}.{name}.zip", WAYS[name])
                now, least = roll(env, draw, Path(), NOTHING)
                base = (last + now) / 2
                found[name].append((own / base - 1, own - base, edges))
                plain.append(now)
                around.append(least)
                doubts.append(abs(now - last) / base)
                last = now
    edge = float(np.median(around))
    ways = {}
    for name, rows in found.items():
        share, more, edges = np.median(rows, axis=0)
        ways[name] = (float(share), float(more), float(edges) - edge)
    return float(np.median(plain)), float(np.median(doubts)), ways


def main() -> None:
    """Measure the environments named on the command line, or all."""
    for name in sys.argv[1:] or ENVIRONMENTS:
        plain, doubt, ways = measure(ENVIRONMENTS[name])
        shares = ", ".join(
            f"{way} {share:+.1%} ({1e6 * more:+.0f} µs; {1e3 * edges:.0f} ms an episode)"
            for way, (share, more, edges) in ways.items()
        )
        print(f"{name}: {1e6 * plain:.0f} µs a control step, ± {doubt:.1%}; {shares}", flush=True)


if __name__ == "__main__":
    main()
