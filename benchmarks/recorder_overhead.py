"""What ``safestage-record`` costs, as a share of the same rollout without it, in one run.

    python benchmarks/recorder_overhead.py [ENVIRONMENT …]

Run it in the simulator's own environment, with ``recorder/`` on PYTHONPATH. The ways to record (none,
frames alone, every physics step) take turns, short stretches of control steps at a time, on one
environment and with the same actions. Processor time of this process, the least of all turns; what begins and
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

TURNS, STEPS = 20, 25
WAYS: dict[str, Any] = {
    "nothing": None,
    "frames": {"frame_dt": None, "substeps": False},
    "steps": {"frame_dt": None},
    "0.01 s": {},
}


def measure(make: Any) -> tuple[dict[str, float], dict[str, float]]:
    """Return s of processor time of a control step, and of an episode's begin and end, by way.

    Each is the least of all turns: what other programs do only ever adds.
    """
    env, draw = make()
    steps = dict.fromkeys(WAYS, np.inf)
    around = dict.fromkeys(WAYS, np.inf)
    gc.disable()
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(TURNS):
            for name, settings in WAYS.items():
                rng = np.random.default_rng(turn % 4)  # the same motions come again
                env.reset()
                actions = [draw(rng) for _ in range(STEPS)]
                recorder: Any = None
                before = time.process_time()
                if settings is not None:
                    path = Path(folder) / f"{turn}.{name}.zip"
                    recorder = safestage_record.find_backend.begin_recording(env, path, **settings)
                env.step(actions[0])
                if recorder is not None:
                    recorder.step(actions[0])  # the first one begins the journal
                begin = time.process_time()
                for action in actions:
                    env.step(action)
                    if recorder is not None:
                        recorder.step(action)
                end = time.process_time()
                if recorder is not None:
                    recorder.close()
                after = time.process_time()
                steps[name] = min(steps[name], (end - begin) / STEPS)
                around[name] = min(around[name], begin - before + after - end - steps[name])
                gc.collect()
    return steps, around


def main() -> None:
    """Measure the environments named on the command line, or all."""
    for name in sys.argv[1:] or ENVIRONMENTS:
        steps, around = measure(ENVIRONMENTS[name])
        plain = steps["nothing"]
        shares = ", ".join(
            f"{way} {steps[way] / plain - 1:+.1%} and {1e3 * around[way]:.0f} ms an episode"
            for way in WAYS
            if way != "nothing"
        )
        print(f"{name}: {1e3 * plain:.2f} ms a control step; {shares}")


if __name__ == "__main__":
    main()
