"""Data of an episode that were read so far, for checks that read nothing themselves."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from safestage_eval.doubts.columns import CONTACTS
from safestage_eval.episode import Mesh, RobotFrames
from safestage_eval.episode.contacts import Pair

from .missing_values import Gaps


class ReadSoFar:
    """The columns, as they were recorded, that signals and relations have looked at."""

    def __init__(self, gaps: Gaps, chained: bool = False) -> None:
        """``gaps``: of the episode's signals, which see all that is read.

        ``chained``: what was found hangs on the contacts of all bodies; their places are read then.
        """
        self._gaps, self._episode, self._chained = gaps, gaps.given, chained
        self._players = {name for names in gaps.given.header.roles.values() for name in names}

    def matters(self, body: str) -> bool:
        """Those that play a role; all if the header binds none, or if what was found is chained."""
        return self._chained or not self._players or body in self._players

    def some(self, body: str) -> bool:
        """See ``doubts.AtHand``."""
        return self._gaps.knows(body)

    def track(self, body: str, column: str) -> NDArray[Any] | None:
        """See ``doubts.AtHand``."""
        if not self._gaps.knows(body, column):
            record = self._episode.bodies[body]
            fixed = not record.movable and record.kind == "fixture"
            free = record.movable and record.kind == "object"
            if column != "position" or not (fixed or (free and self._chained)):
                return None
        found: NDArray[Any] = getattr(self._episode.tracks[body], column)
        return found

    def contacts(self, pair: Pair, *read: str) -> Mapping[str, NDArray[Any]]:
        """See ``doubts.AtHand``."""
        asked = self._gaps.asked.get(pair, ())
        names = [column for column in CONTACTS if column in asked or column in read]
        if not names:
            return {}
        return dict(zip(names, self._episode.contacts.of_pair(pair, *names), strict=True))

    def frames(self) -> RobotFrames | None:
        """See ``doubts.AtHand``."""
        found: RobotFrames | None = vars(self._gaps.episode).get("frames")
        return found

    def meshes(self) -> Mapping[str, Mesh]:
        """See ``doubts.AtHand``."""
        return self._episode.meshes
