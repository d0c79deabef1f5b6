"""What ``safestage-record`` costs, as a share of the same rollout without it, in one run.

    python benchmarks/recorder_overhead.py [ENVIRONMENT …]

Run it in the simulator's own environment, with ``recorder/`` on PYTHONPATH. The ways to record (none,
frames alone, every physics step) take turns, short stretches of control steps at a time, on one
environment and with the same actions, so that whatever else the machine does falls on all of them alike.
Processor time of this process; the share is of sums over all stretches. Writing the file is included.
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
from safestage_record.find_backend import find_simulation

TURNS, STEPS = 9, 200
WAYS: dict[str, Any] = {
    "nothing": None,
    "frames": {"frame_dt": None, "substeps": False},
    "steps": {"frame_dt": None},
    "0.01 s": {},
}


def measure(make: Any) -> dict[str, float]:
    """Return s of processor time by way of recording, over all turns, and the control steps."""
    env, draw = make()
    spent = dict.fromkeys(WAYS, 0.0)
    gc.disable()
    with tempfile.TemporaryDirectory() as folder:
        for turn in range(TURNS):
            for name, settings in WAYS.items():
                rng = np.random.default_rng(turn)
                env.reset()
                model, data = find_simulation(env)
                actions = [draw(rng) for _ in range(STEPS)]
                begin = time.process_time()
                if settings is None:
                    for action in actions:
                        env.step(action)
                else:
                    path = Path(folder) / f"{turn}.{name}.zip"
                    with safestage_record.mujoco(model, data, path, **settings) as recorder:
                        for action in actions:
                            env.step(action)
                            recorder.step(action)
                if turn:  # the first one warms up
                    spent[name] += time.process_time() - begin
                gc.collect()
    return spent


def main() -> None:
    """Measure the environments named on the command line, or all."""
    for name in sys.argv[1:] or ENVIRONMENTS:
        spent = measure(ENVIRONMENTS[name])
        steps = (TURNS - 1) * STEPS
        plain = spent["nothing"]
        shares = ", ".join(
            f"{way} {spent[way] / plain - 1:+.1%}" for way in WAYS if way != "nothing"
        )
        print(f"{name}: {1e3 * plain / steps:.2f} ms a control step; {shares}")


if __name__ == "__main__":
    main()
