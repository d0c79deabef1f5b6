"""What is kept of each episode for the checks of an evaluation, and all of it together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from safestage_eval.errors import readable

from .subject import Subject


@dataclass(frozen=True)
class Summary:
    """What the checks of an evaluation need to know of one episode; small, and can be pickled.

    Attributes:
        episode_id, task, policy, prompt, seed, rollout: of the header.
        path: of its file, as printed.
        success, success_time, termination: of the header.
        content_hash: as the file states it; None if it states none.
        duration: s, from the first sample to the last.
    """

    episode_id: str
    path: str
    task: str | None
    policy: str | None
    prompt: str | None
    seed: int | None
    rollout: int | None
    success: bool | None
    success_time: float | None
    termination: str | None
    content_hash: str | None
    duration: float


def summarize(subject: Subject, content_hash: str | None = None) -> Summary:
    """The summary of an episode; ``content_hash``: as its file states it."""
    header, t = subject.header, subject.episode.t
    return Summary(
        episode_id=header.episode_id,
        path=readable(subject.episode.path or ""),
        task=header.task,
        policy=header.policy,
        prompt=header.prompt,
        seed=header.seed,
        rollout=header.rollout,
        success=header.success,
        success_time=header.success_time,
        termination=header.termination,
        content_hash=content_hash,
        duration=float(t[-1] - t[0]) if len(t) else 0.0,
    )


@dataclass(frozen=True)
class Campaign:
    """Everything that was audited, as the checks of an evaluation see it.

    Attributes:
        episodes: summaries of all that could be read, in the order in which they were found.
        unreadable: how many could not be read.
        aborted: ids of rollouts that ended in an error; they are in no other number.
    """

    episodes: Sequence[Summary]
    unreadable: int = 0
    aborted: Sequence[str] = ()
