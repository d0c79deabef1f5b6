"""Episodes judged in worker processes of this machine: one that dies, hangs or swells costs its own verdicts alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

from safestage_eval._process.children import Children, Ended, Question
from safestage_eval._process.closing import Closing
from safestage_eval.formats import EpisodeRef
from safestage_eval.size_limits import current
from safestage_eval.verdicts import EpisodeResult
from safestage_eval.verdicts.problem import Problem

from .settings import Settings
from .worker import Line
from .worker import opened as scoring

Numbered = tuple[int, EpisodeRef]
"""An episode and its number in the run."""

Found = EpisodeResult | Line | Problem

AHEAD = 16
"""Episodes that a process is sent at a time, at most. They lie in one file mostly, whose end need
then be read by fewer processes."""

PRELOAD = "safestage_eval.run.preload"
"""Module that several workers share."""

STUCK = 4
"""Times the processor time of an episode that may go by on the clock: machines are shared. A process ends
itself over an episode, unless it is in a library that does not come back."""


class Local(Closing):
    """Judges episodes as they come, with what was found given back as it comes: neither are ever all held."""

    def __init__(
        self,
        workers: int,
        settings: Settings,
        *args: Any,
        opened: Callable[..., Callable[[EpisodeRef], Any]] = scoring,
        lines: bool = False,
    ) -> None:
        """Nothing is started before there is an episode.

        Args:
            workers: processes.
            settings: of the run.
            args: others of ``opened``.
            opened: gives what a process does with an episode.
            lines: give results as they are stored (``Line``).
        """
        self._seconds = settings.timeout
        bound = settings.timeout is not None or settings.memory is not None
        self._children = Children(
            workers, _numbered, opened, settings, *args, *([lines] if opened is scoring else []),
            memory=settings.memory, ahead=1 if bound else AHEAD,
            preload=PRELOAD if workers > 1 else None,
        )  # fmt: skip

    def close(self) -> None:
        """End the processes."""
        self._children.close()

    def run(self, episodes: Iterable[Numbered]) -> Iterator[tuple[int, Any]]:
        """Each number with what was found, in whatever order; every episode exactly once.

        Whatever is wrong with an episode becomes a ``Problem``: broken bytes, an unforeseen error, a
        process that died twice over it, too much time, too much memory.

        Raises InputError when no process can be started at all.
        """
        most = STUCK * current().seconds if self._seconds is None else self._seconds
        questions = (Question(numbered, most) for numbered in episodes)
        for question, answer in self._children.run(questions):
            number, ref = question.what
            if isinstance(answer, Ended):
                why = f"judging it {answer.why}" if answer.bound else answer.why
                yield number, Problem(ref.shown, f"{ref.shown}: {why}")
            else:
                yield number, answer


def _numbered(
    opened: Callable[..., Callable[[EpisodeRef], Any]], *args: Any
) -> Callable[[Numbered], Any]:
    """What answers for numbered episodes, in a process that does nothing else."""
    answer = opened(*args)
    return lambda numbered: answer(numbered[1])
