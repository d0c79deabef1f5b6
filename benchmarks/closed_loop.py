"""Control steps per second in closed loop: blind, and with the cameras of each protocol.

    python benchmarks/closed_loop.py [--jobs 1,2] [--task TASK]

A server in this process answers at once, always to stay where the arm is, so the model's own time is
not in the figures. Two rollouts of different length are compared, so that loading the scene is not
either. Where nothing else runs, wall time is what counts; on a busy machine, processor time.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
from machine import machine

from simulate.arm import droid
from simulate.clients.address import dialect_named
from simulate.clients.dialect import Dialect
from simulate.clients.message_arrays import pack, unpack
from simulate.policy import Observation
from simulate.record.jobs import plan, record
from simulate.servers.served_answers import DONE
from simulate.servers.websocket import WebsocketServer
from simulate.servers.zeromq import ZeromqServer
from simulate.tasks.task import task_named
from simulate.world.world import CONTROL_RATE

SHORT, LONG, BLIND = 1.0, 5.0, 40.0
"""s of episode; the last one instead of the second where nothing is drawn, as that is soon over."""


class ByRote:
    """A server's answers that do not depend on what is seen: that the arm stays at home."""

    def __init__(self, dialect: Dialect) -> None:
        self._dialect = dialect
        self._home = np.tile(np.append(droid.HOME, 0.0), (dialect.rows, 1))

    def greeting(self) -> bytes:
        """Text before the table."""
        return pack(self._dialect.greeting(), self._dialect.arrays)

    def answered(self, message: bytes) -> bytes | str:
        """The answer to a message of a client."""
        request = unpack(message)
        if request.get("endpoint") == "reset":
            return DONE if self._dialect.schemes[0] == "ws" else pack({})
        if request.get("endpoint") == "get_modality_config":
            return pack(self._dialect.described())
        seen = self._dialect.asked(request).observation
        return pack(self._dialect.answer(self.rows(seen), seen), self._dialect.arrays)

    def rows(self, _seen: Observation) -> np.ndarray:
        """(rows, 8) positions of the joints, rad, and of the gripper."""
        return self._home


def spent() -> tuple[float, float]:
    """Wall time and processor time, of this process and those that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return time.monotonic(), sum(each.ru_utime + each.ru_stime for each in used)


def taken(policy: str, task: str, horizon: float, jobs: int) -> np.ndarray:
    """(2,) s of wall and of processor for ``jobs`` rollouts in as many processes."""
    todo = plan([task_named(task)], [policy], range(jobs), horizon=horizon)
    with tempfile.TemporaryDirectory() as folder:
        before = spent()
        for outcome in record(todo, Path(folder), jobs=jobs):
            if outcome.problem:
                raise SystemExit(outcome.problem)
        return np.subtract(spent(), before)


def measure(label: str, policy: str, task: str, jobs: int) -> None:
    """Print a row."""
    long = BLIND if policy == "idle" else LONG
    wall, processor = taken(policy, task, long, jobs) - taken(policy, task, SHORT, jobs)
    steps = jobs * (long - SHORT) * CONTROL_RATE
    print(f"| {label} | {jobs} | {steps / wall:.1f} | {steps / processor:.1f} |", flush=True)


def main() -> None:
    """Measure all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--jobs", default="1")
    parser.add_argument("--task", default="fsh_orange_on_plate")
    parser.add_argument("--only", default="idle,openpi,groot,dreamzero,cosmos3")
    given = parser.parse_args()
    taken("idle", given.task, SHORT, 1)  # compiles and loads what is needed only once
    print(f"{machine()}, {os.cpu_count()} processors; control steps per second")
    print("| policy | environments | of wall time | of processor time |\n|---|---|---|---|")
    for jobs in map(int, given.jobs.split(",")):
        for name in given.only.split(","):
            if name == "idle":
                measure("blind", "idle", given.task, jobs)
                continue
            dialect = dialect_named(name)()
            kind = ZeromqServer if dialect.schemes[0] == "tcp" else WebsocketServer
            with kind(partial(ByRote, dialect)) as server:  # type: ignore[arg-type]
                address = f"{name}:{server.url}?wait=60&timeout=600"
                label = f"{name}: {len(dialect.cameras)} cameras every {dialect.horizon} steps"
                measure(label, address, given.task, jobs)


if __name__ == "__main__":
    main()
