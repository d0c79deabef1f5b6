"""Records many rollouts into a folder, one after the other, leaving out what is there already."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Literal

from safestage_eval.errors import InputError, TraceError
from safestage_eval.formats import discover

from .policies import policy_named
from .rollout import Setting, roll_out
from .task import Task
from .world import FRAME_RATE

Format = Literal["parquet", "mcap"]


@dataclass(frozen=True)
class Job:
    """One rollout to be recorded."""

    setting: Setting
    policy: str

    @property
    def episode_id(self) -> str:
        """The id that its episode has, whenever it is recorded."""
        return self.setting.episode_id(policy_named(self.policy).name)


@dataclass(frozen=True)
class Outcome:
    """What became of a job."""

    job: Job
    skipped: bool = False
    """An episode with this id was there already."""
    problem: str = ""
    """Why nothing was recorded, if so."""
    success_time: float | None = None
    """s."""
    simulated: float = 0.0
    """s of episode."""
    taken: float = 0.0
    """s of processor time, writing included."""


def jobs(
    tasks: Iterable[Task],
    policies: Sequence[str],
    seeds: Sequence[int],
    prompts: Sequence[str] = ("default",),
    rollouts: int = 1,
    *,
    horizon: float | None = None,
    robot_mjcf: Path | None = None,
) -> list[Job]:
    """Every combination, tasks outermost. ``horizon`` (s) replaces the tasks' own."""
    return [
        Job(Setting(task, seed, prompt, rollout, horizon, robot_mjcf), policy)
        for task, policy, prompt, seed, rollout in product(
            tasks, policies, prompts, seeds, range(rollouts)
        )
    ]


def record(
    todo: Sequence[Job],
    out: Path,
    format: Format = "parquet",  # noqa: A002 - the word of the command line
    progress: Callable[[Job, float], None] | None = None,
) -> Iterator[Outcome]:
    """Record jobs into a folder; each outcome is yielded when its episode is safely on disk.

    A job whose episode is there already is skipped, so that a recording can be taken up again. One
    that fails does not stop the others.

    Args:
        todo: see ``jobs``.
        out: a Parquet dataset, or the folder of MCAP files.
        format: which of the two.
        progress: told the job and its simulated time (s), after each action.

    Raises:
        InputError: an unknown policy.
    """
    for name in {job.policy for job in todo}:
        policy_named(name)  # what is none stops the run before it begins
    there = recorded_ids(out)
    for job in todo:
        if job.episode_id in there:
            yield Outcome(job, skipped=True)
            continue
        start = time.process_time()
        try:
            writer = roll_out(
                job.setting,
                policy_named(job.policy, job.setting.draw),
                None if progress is None else lambda t, job=job: progress(job, t),  # type: ignore[misc]
            )
            writer.attachments |= _attachments(job.setting.task)
            out.mkdir(parents=True, exist_ok=True)
            writer.close(out / f"{job.episode_id}.mcap" if format == "mcap" else out)
        except (InputError, ValueError) as error:
            yield Outcome(job, problem=str(error))
            continue
        yield Outcome(
            job,
            success_time=writer.header.success_time,
            simulated=len(writer) / FRAME_RATE,
            taken=time.process_time() - start,
        )


def recorded_ids(folder: Path) -> set[str]:
    """Ids of the whole episodes under a folder; empty when there is none."""
    if not folder.exists():
        return set()
    try:
        refs = discover([folder])
    except TraceError:
        return set()
    return {ref.episode_id for ref in refs if ref.episode_id and ref.problem is None}


def _attachments(task: Task) -> dict[str, bytes]:
    return {} if task.source is None else dict([task.source])
