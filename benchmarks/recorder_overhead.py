"""What ``safestage-record`` costs, as a share of the same rollout without it, in one run.

    python benchmarks/recorder_overhead.py [ENVIRONMENT …]

Run it in the simulator's own environment, with ``recorder/`` on PYTHONPATH. The ways to record (none,
frames alone, every physics step) take turns, short stretches of control steps at a time, on one
environment and with the same actions. Processor time of this process, the median over all control steps of a
way; "nothing" is measured twice, and by how much the two differ is what can be told. What begins and
ends an episode, its file included, is told apart.
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

TURNS, STEPS = 24, 25
WAYS: dict[str, Any] = {
    "nothing": None,
    "frames": {"frame_dt": None, "substeps": False},
    "steps": {"frame_dt": None},
    "0.01 s": {},
    "again nothing": None,
}


def measure(make: Any) -> tuple[dict[str, float], dict[str, float]]:
    """Return s of processor time of a control step, and of an episode's begin and end, by way: medians."""
    env, draw = make()
    steps: dict[str, list[float]] = {name: [] for name in WAYS}
    around: dict[str, list[float]] = {name: [] for name in WAYS}
    gc.disable()
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(TURNS):
            for name in np.random.default_rng(turn).permutation(list(WAYS)):
                rng = np.random.default_rng(turn % 4)  # the same motions come again
                env.reset()
                actions = [draw(rng) for _ in range(STEPS)]
                recorder: Any = None
                before = time.process_time()
                if WAYS[name] is not None:
                    path = Path(folder) / f"{turn}.{name}.zip"
                    recorder = safestage_record.find_backend.begin_recording(
                        env, path, **WAYS[name]
                    )
                env.step(actions[0])
                if recorder is not None:
                    recorder.step(actions[0])  # the first one begins the journal
                begun = time.process_time()
                for action in actions:
                    begin = time.process_time()
                    env.step(action)
                    if recorder is not None:
                        recorder.step(action)
                    steps[name].append(time.process_time() - begin)
                ended = time.process_time()
                if recorder is not None:
                    recorder.close()
                around[name].append(begun - before + time.process_time() - ended)
                gc.collect()
    medians = {name: float(np.median(some)) for name, some in steps.items()}
    return medians, {name: float(np.median(some)) - medians[name] for name, some in around.items()}


def main() -> None:
    """Measure the environments named on the command line, or all."""
    for name in sys.argv[1:] or ENVIRONMENTS:
        steps, around = measure(ENVIRONMENTS[name])
        plain = (steps["nothing"] + steps["again nothing"]) / 2
        shares = ", ".join(
            f"{way} {steps[way] / plain - 1:+.1%} ({1e6 * (steps[way] - plain):+.0f} µs; "
            f"{1e3 * around[way]:.0f} ms an episode)"
            for way, settings in WAYS.items()
            if settings is not None
        )
        doubt = abs(steps["nothing"] - steps["again nothing"]) / plain
        print(f"{name}: {1e6 * plain:.0f} µs a control step, ± {doubt:.1%}; {shares}", flush=True)


if __name__ == "__main__":
    main()
