"""What the checks of columns look at: one episode, as far as it is at hand.

A file may be well formed, its digests right, and still say centimetres for metres. What the trace
itself shows to be wrong is found by comparing what it says twice: velocities with poses, contacts with
poses and shapes, forces with weights. What nobody could see is not: all lengths, say, in another unit
together with gravity.

Nothing is read for it. ``AtHand`` gives the columns that were read for a verdict, so that what a
verdict rests on is checked at hardly any cost, or everything (``safestage audit``).
"""

from __future__ import annotations

from collections.abc import Mapping
from operator import is_
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode, Mesh, RobotFrames
from safestage_eval.episode.contacts import Pair
from safestage_eval.episode.invariants import measured
from safestage_eval.episode.rounding import Rounding, rounding_of
from safestage_eval.episode.scene_shapes import BodyShapes, body_shapes

Array = NDArray[Any]

CONTACTS = ("frame", "position", "normal", "force", "force.z", "peak_force", "depth")
"""Columns of contacts that are looked at."""


class AtHand:
    """Columns that may be looked at: all of an episode; other classes have less at hand."""

    def __init__(self, episode: Episode) -> None:
        self._episode = episode

    def matters(self, body: str) -> bool:
        """Whether contacts and forces of a body are to be looked at."""
        return body in self._episode.tracks

    def some(self, body: str) -> bool:
        """Whether any column of a body's track is at hand."""
        return body in self._episode.tracks

    def track(self, body: str, column: str) -> Array | None:
        """A column as in ``Track``; None where it is not at hand.

        The place of a fixture is one row, and may be read; that of a free body where it matters.
        """
        found: Array = getattr(self._episode.tracks[body], column)
        return found

    def contacts(self, pair: Pair, *read: str) -> Mapping[str, Array]:  # noqa: ARG002
        """Columns of the contacts of a pair, as ``ContactTable.of_pair``, by name.

        ``read``: columns that are to be read if they are not at hand.
        """
        return dict(zip(CONTACTS, self._episode.contacts.of_pair(pair, *CONTACTS), strict=True))

    def frames(self) -> RobotFrames | None:
        """Joints and gripper; None where they are not at hand."""
        return self._episode.frames

    def meshes(self) -> Mapping[str, Mesh]:
        """Those at hand."""
        return self._episode.meshes


_SOUND: list[tuple[tuple[Body, ...], frozenset[str]]] = []
"""Bodies of scenes that were met lately and found sound, and which of them were at hand."""


class Columns:
    """One episode, as far as it is at hand.

    Attributes:
        episode, header: as given.
        t: (T,) s.
        at_hand: what may be looked at.
        pairs: pair → columns of its contacts that are at hand, of pairs with a body that matters.
        found: what checks leave for each other.
    """

    def __init__(self, episode: Episode, at_hand: AtHand | None = None) -> None:
        """``at_hand``: what may be read, None: all."""
        self.episode, self.header, self.t = episode, episode.header, episode.t
        self.at_hand = AtHand(episode) if at_hand is None else at_hand
        self.found: dict[Any, Any] = {}
        self._meshes = self.at_hand.meshes()
        self._roundings: dict[str, Rounding] = {}
        matters = [self.at_hand.matters(body.name) for body in episode.header.bodies]
        self.pairs = {
            (i, j): {
                name: measured(values) for name, values in self.at_hand.contacts((i, j)).items()
            }
            for i, j in episode.contacts.pairs
            if matters[i] or matters[j]
        }
        self.some = [body for body in self.header.bodies if self.at_hand.some(body.name)]
        self._seen = frozenset(body.name for body in self.some)

    def track(self, body: Body, column: str) -> Array | None:
        """See ``AtHand``; with NaN for what is infinite."""
        found = self.at_hand.track(body.name, column)
        return None if found is None else measured(found)

    def rounding(self, column: str) -> Rounding:
        """That of a column of contacts, as far as it is at hand."""
        if column not in self._roundings:
            parts = [told[column].ravel() for told in self.pairs.values() if column in told]
            self._roundings[column] = rounding_of(np.concatenate([*parts, np.zeros(0, np.float32)]))
        return self._roundings[column]

    def shapes(self, body: Body) -> BodyShapes | None:
        """Its shapes, for which meshes are read; None where it has none."""
        return body_shapes(body, self._meshes)

    def scene(self) -> tuple[Body, ...]:
        """The bodies, for what is said once of them; none where just these were found sound before.

        The scenes of a task share their bodies.
        """
        for known, seen in _SOUND:
            same = len(known) == len(self.header.bodies) and all(
                map(is_, known, self.header.bodies)
            )
            if same and self._seen <= seen:
                return ()
        return self.header.bodies

    def remember_sound(self) -> None:
        """Note that what is said once of these bodies is sound."""
        if self.scene():
            _SOUND[:] = [(self.header.bodies, self._seen), *_SOUND[:7]]

    def solid(self) -> list[tuple[Body, BodyShapes]]:
        """Objects of ``scene`` with their shapes, of those that have any and have an end."""
        seen = [b for b in self.scene() if b.kind == "object" and b.name in self._seen]
        objects = [(b, self.shapes(b)) for b in seen]
        return [(b, shapes) for b, shapes in objects if shapes is not None]
