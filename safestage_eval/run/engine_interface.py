"""Interface of every engine."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from safestage_eval.formats import EpisodeRef
from safestage_eval.verdicts import EpisodeResult
from safestage_eval.verdicts.problem import Problem

Numbered = tuple[int, EpisodeRef]
"""An episode and its number in the run."""


class Line(NamedTuple):
    """A result as it is stored, and by what it is known again."""

    text: bytes
    episode_id: str
    trace_hash: str


Found = EpisodeResult | Line | Problem


class Engine(ABC):
    """Judges episodes somewhere.

    An engine takes episodes as it needs them and gives results as they come, so that neither all
    episodes nor all results are ever held.
    """

    @abstractmethod
    def run(self, episodes: Iterable[Numbered]) -> Iterator[tuple[int, Found]]:
        """Each number with what was found, in whatever order; every episode exactly once.

        Whatever is wrong with an episode becomes a ``Problem``: broken bytes, an unforeseen error, a
        process that died twice over it, too much time, too much memory.

        Raises InputError when no process can be started at all.
        """
