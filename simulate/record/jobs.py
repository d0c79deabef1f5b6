"""Records many rollouts into a folder, in one process or several, leaving out what is there."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Literal

from safestage_eval.episode import Header
from safestage_eval.errors import InputError, TraceError
from safestage_eval.formats import TraceWriter, discover
from safestage_eval.formats.discover import aborted
from simulate.policies.policy_names import policy_name, policy_named
from simulate.policies.reference_policies import KINDS
from simulate.tasks.task import Task
from simulate.world.world import FRAME_RATE, FRAMES_PER_ACTION

from .rollout import Setting, roll_out
from .watch import Watching
from .worker_pool import Died, run_many

Format = Literal["parquet", "mcap"]

GIVES_UP = 5
"""Rollouts of one policy in a row, in one process, that got no first action from it: those that
follow are left for the next run, instead of waiting for a dead server each."""
_unreachable: Counter[str] = Counter()


@dataclass(frozen=True)
class Job:
    """One rollout to be recorded."""

    setting: Setting
    policy: str

    @property
    def episode_id(self) -> str:
        """The id that its episode has, whenever it is recorded."""
        return self.setting.episode_id(policy_name(self.policy))


@dataclass(frozen=True)
class Outcome:
    """Outcome of a job."""

    episode_id: str
    skipped: bool = False
    """An episode with this id was there already."""
    problem: str = ""
    """Why nothing was recorded; empty if something was."""
    success_time: float | None = None
    """s."""
    simulated: float = 0.0
    """s of episode."""
    taken: float = 0.0
    """s of processor time, writing included; 0 if its process died right after writing."""
    aborted: bool = False
    """Whether it ended in an error; the recording until then is kept, and the job tried again."""
    stopped: str = ""
    """At which violation it was stopped, if it was."""

    def __str__(self) -> str:
        """In words."""
        if self.skipped:
            return "there already"
        if self.problem:
            return self.problem if self.aborted else f"not recorded: {self.problem}"
        if self.stopped:
            said = f"{self.stopped}, {self.simulated:.1f} s"
        elif self.success_time is None:
            said = f"goal not reached in {self.simulated:.1f} s"
        else:
            said = f"reached after {self.success_time:.1f} s, {self.simulated:.1f} s"
        speed = f" at {self.simulated / self.taken:.0f}x real time" if self.taken else ""
        return f"{said} recorded{speed}"


def plan(
    tasks: Iterable[Task],
    policies: Sequence[str],
    seeds: Sequence[int],
    prompts: Sequence[str] = ("default",),
    rollouts: int = 1,
    *,
    horizon: float | None = None,
    robot_mjcf: Path | None = None,
) -> list[Job]:
    """Every combination, tasks outermost.

    ``reference:NAME`` of a grade stands for all its values, in the tasks that have it. ``horizon``
    (s) replaces the tasks' own. Raises InputError for a grade that no task has, and for two policies
    of one name.
    """
    called: dict[str, str] = {}
    for policy in (name for name in dict.fromkeys(policies) if not _grade(name)):
        other = called.setdefault(policy_name(policy), policy)
        if other != policy:
            raise InputError(
                f"policies {other!r} and {policy!r}",
                f"both are called {policy_name(policy)!r}.",
                fix="give served ones a name each: PROTOCOL:URL?name=NAME",
            )
    chosen = list(tasks)
    for name in policies:
        if _grade(name) and not any(_grade(name) in task.grades for task in chosen):
            graded = sorted({grade for task in chosen for grade in task.grades})
            raise InputError(
                f"policy {name!r}", "none of the tasks has a grade of that name.",
                ", ".join([*KINDS, *graded]),
            )  # fmt: skip
    return [
        Job(Setting(task, seed, prompt, rollout, horizon, robot_mjcf), policy)
        for task in chosen
        for policy, prompt, seed, rollout in product(
            _of_task(task, policies), prompts, seeds, range(rollouts)
        )
    ]


def record(
    todo: Sequence[Job],
    out: Path,
    format: Format = "parquet",  # noqa: A002 - the word of the command line
    jobs: int = 1,
    done: Callable[[int], None] | None = None,
    watching: Watching | None = None,
    *,
    video: bool = False,
) -> Iterator[Outcome]:
    """Record jobs into a folder; each outcome is yielded when its episode is safely on disk.

    A job whose episode is there already is skipped, so that a recording can be taken up again; one
    that ended in an error is tried again. One that fails, or takes its process along, does not stop
    the others.

    Args:
        todo: see ``plan``.
        out: a Parquet dataset, or the folder of MCAP files.
        format: which of the two.
        jobs: processes.
        done: called with the number of jobs done.
        watching: rules that are judged meanwhile.
        video: film what the cameras see, into ``out/videos``.

    Raises:
        InputError: an unknown policy.
    """
    _unreachable.clear()
    ids = [job.episode_id for job in todo]
    there, tried = _ids(out)
    missing = [job for job, name in zip(todo, ids, strict=True) if name not in there]
    already = len(todo) - len(missing)
    outcomes = run_many(
        partial(record_one, out=out, format=format, watching=watching, video=video, tried=tried),
        missing,
        jobs,
        None if done is None else lambda n: done(already + n),
        partial(finished_job, out=out, tried=tried),
    )
    for name in ids:
        if name in there:
            yield Outcome(name, skipped=True)
            continue
        outcome = next(outcomes)
        yield Outcome(name, problem=outcome.reason) if isinstance(outcome, Died) else outcome


def record_one(
    job: Job,
    out: Path,
    format: Format = "parquet",  # noqa: A002
    watching: Watching | None = None,
    *,
    video: bool = False,
    tried: AbstractSet[str] = frozenset(),
) -> Outcome:
    """Roll out and write one episode; what goes wrong is returned, not raised.

    Of the ids in ``tried`` there is an episode that ended in an error. Another one is not written in
    its place when it got no first action either: a server that is not there all night fills no disk.
    """
    start = time.process_time()
    if _unreachable[job.policy] >= GIVES_UP:
        return Outcome(job.episode_id, problem=f"not tried, as {GIVES_UP} before it: {job.policy}")
    try:
        film = out / "videos" / f"{job.episode_id}.mp4" if video else None
        policy = policy_named(job.policy, job.setting.draw)
        writer = roll_out(job.setting, policy, film, watching)
        failed = writer.header.termination == "error"
        unheard = failed and len(writer) <= FRAMES_PER_ACTION
        if not (unheard and job.episode_id in tried):
            write_recording(writer, job.setting.task, out, format)
    except Exception as error:  # noqa: BLE001 - whatever it is, the others go on
        expected = isinstance(error, InputError | ValueError)
        return Outcome(
            job.episode_id, problem=str(error) if expected else f"{type(error).__name__}: {error}"
        )
    if unheard:
        _unreachable[job.policy] += 1
    else:
        _unreachable.pop(job.policy, None)
    return _outcome(writer.header, len(writer), time.process_time() - start)


def finished_job(job: Job, out: Path, tried: AbstractSet[str]) -> Outcome | None:
    """Outcome of a job whose process died after the episode was written; None if it was not.

    An id in ``tried`` may belong to the earlier try, so nothing is known of it.
    """
    if job.episode_id in tried or not out.exists():
        return None
    for ref in discover([out], maybe_none=True):
        if ref.problem is None and ref.episode_id == job.episode_id:
            episode = ref.open()
            return _outcome(episode.header, len(episode), 0.0)
    return None


def _outcome(header: Header, frames: int, taken: float) -> Outcome:
    """Outcome of a recorded episode; ``taken`` is the processor time in s."""
    failed = header.termination == "error"
    simulated = frames / FRAME_RATE
    return Outcome(
        header.episode_id,
        problem=f"{header.notes[-1]} (after {simulated:.1f} s)" if failed else "",
        aborted=failed,
        success_time=header.success_time,
        simulated=simulated,
        taken=taken,
        stopped=header.notes[-1] if header.termination == "truncated" else "",
    )


def write_recording(
    writer: TraceWriter,
    task: Task,
    out: Path,
    format: Format = "parquet",  # noqa: A002
) -> None:
    """Write an episode and its task file into a folder, which is made if it is not there."""
    writer.attachments |= _attachments(task)
    out.mkdir(parents=True, exist_ok=True)
    writer.close(out / f"{writer.header.episode_id}.mcap" if format == "mcap" else out)


def summary(outcomes: Sequence[Outcome]) -> str:
    """One line on the outcome of recording."""
    new = [o for o in outcomes if not (o.skipped or o.problem)]
    parts = [f"{len(new)} recorded"]
    if new:
        reached = sum(o.success_time is not None for o in new)
        simulated, taken = sum(o.simulated for o in new), sum(o.taken for o in new)
        parts[0] += (
            f" ({reached} reached the goal; {simulated:.0f} s in {taken:.0f} s of processor)"
        )
    there = sum(o.skipped for o in outcomes)
    aborted_ones = sum(o.aborted for o in outcomes)
    failed = sum(bool(o.problem) and not o.aborted for o in outcomes)
    if there:
        parts.append(f"{there} there already")
    if aborted_ones:
        parts.append(f"{aborted_ones} ended in an error")
    if failed:
        parts.append(f"{failed} not recorded")
    return ", ".join(parts)


def recorded_ids(folder: Path) -> set[str]:
    """Ids of the whole episodes under a folder that need not be tried again; often none."""
    return _ids(folder)[0]


def _ids(folder: Path) -> tuple[set[str], set[str]]:
    """Like ``recorded_ids``, and the ids of those that ended in an error."""
    if not folder.exists():
        return set(), set()
    try:
        refs = discover([folder])
    except TraceError:
        return set(), set()
    result: tuple[set[str], set[str]] = set(), set()
    for ref in refs:
        if ref.problem is None and ref.episode_id:
            result[aborted(ref)].add(ref.episode_id)
    return result


def _grade(policy: str) -> str:
    """The grade whose values a policy's name asks for all; empty if it does not."""
    kind, _, rest = policy.partition(":")
    return rest if kind == "reference" and rest not in KINDS and "=" not in rest else ""


def _of_task(task: Task, policies: Sequence[str]) -> list[str]:
    out = []
    for policy in policies:
        grade = _grade(policy)
        if not grade:
            out.append(policy)
        elif grade in task.grades:
            out += [f"{policy}={value:g}" for value in task.grades[grade].values]
    return out


def _attachments(task: Task) -> dict[str, bytes]:
    return {} if task.source is None else dict([task.source])
