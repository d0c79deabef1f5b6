"""How bodies lie against each other, and from when on they lie differently."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode, Geom
from safestage_eval.episode.contacts import Pair
from safestage_eval.evidence.contact_kernels import rows_by_frame
from safestage_eval.geometry.pose import transform

from .near import NOTHING, Patch
from .shifts import Layout, stays_for, stretch_starts

Bool = NDArray[np.bool_]
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


At = NDArray[np.intp] | slice

STAYS = (1e-3, float(np.radians(1.0)))
"""m, rad: what nobody touches and what has moved by less since hangs together as it did."""


class Arrangement:
    """The contacts that carry something, and stretches of frames over which they stay the same.

    A contact point without force (one within the simulator's margin, or between two physics steps)
    carries nothing.
    """

    def __init__(self, episode: Episode) -> None:
        """Nothing is computed before it is asked for."""
        self._episode = episode
        bodies = episode.header.bodies
        self._names = [body.name for body in bodies]
        self._first_geom = np.cumsum([0, *(len(body.geoms) for body in bodies)])
        rough = [g.friction[0] for body in bodies for g in body.geoms]
        self._friction = np.array([*rough, Geom.model_fields["friction"].default[0]])
        self._rows: dict[Pair, NDArray[np.intp]] = {}
        self._starts: dict[Pair, NDArray[np.intp]] = {}
        self._sides: dict[Pair, list[NDArray[np.int64]]] = {}
        self._columns: dict[Pair, tuple[NDArray[Any], ...]] = {}
        self._stacked: dict[tuple[int, ...], tuple[F32, F32]] = {}

    def points(self, pair: Pair, some: At) -> Patch:
        """Some of the pair's contact points with a force, by their number in the order of frames."""
        if pair not in self._columns:
            self._columns[pair] = self._episode.contacts.of_pair(
                pair, "position", "normal", "force"
            )
        rows = self._of(pair)[some]
        position, normal, force = (
            column[rows].astype(np.float64) for column in self._columns[pair]
        )
        geoms = (geom[some] if len(geom) > 1 else geom for geom in self._geoms(pair))
        last = len(self._friction) - 1  # of a geom that the header does not have
        rough = np.maximum(*(self._friction[np.minimum(geom, last)] for geom in geoms))
        return Patch(position, normal, np.broadcast_to(rough, len(rows)), force)

    def starts(self, pair: Pair) -> NDArray[np.intp]:
        """(T + 1,) the points of frame t are those from starts[t] to starts[t + 1]."""
        self._of(pair)
        return self._starts[pair]

    def _of(self, pair: Pair) -> NDArray[np.intp]:
        """(N,) the pair's rows with a force, among its own, by frame."""
        if pair not in self._rows:
            frame, normal, force = self._episode.contacts.of_pair(pair, "frame", "normal", "force")
            frames = len(self._episode)
            rows = self._rows[pair] = rows_by_frame(frame, force, normal, frames)
            starts = self._starts[pair] = np.zeros(frames + 1, np.intp)
            np.cumsum(np.bincount(frame[rows], minlength=frames), out=starts[1:])
        return self._rows[pair]

    def _geoms(self, pair: Pair) -> list[NDArray[np.int64]]:
        """On each side, of which geom each point is: (N,), or (1,) where the body has but one."""
        if pair not in self._sides:
            sides = self._sides[pair] = []
            for body, column in zip(pair, ("geom1", "geom2"), strict=True):
                first, end = self._first_geom[body : body + 2]
                if end - first == 1:
                    sides.append(np.array([first], np.int64))
                else:
                    (geoms,) = self._episode.contacts.of_pair(pair, column)
                    sides.append(geoms[self._of(pair)].astype(np.int64))
        return self._sides[pair]

    def touching(self, pair: Pair) -> Bool:
        """(T,) true where the pair has a row with a force."""
        starts = self.starts(pair)
        return np.asarray(starts[1:] > starts[:-1])

    def signature(self, pairs: Iterable[Pair]) -> NDArray[np.int64]:
        """(T,) equal where equal sets of contact points of the pairs carry something."""
        frames = len(self._episode)
        signature = np.zeros(frames, np.int64)
        for pair in pairs:
            starts, mixed = self.starts(pair), _mixed(*self._geoms(pair))
            if len(mixed) == 1:  # one geom on each side
                signature += mixed * np.diff(starts)
            else:
                signature += np.diff(np.append(0, mixed.cumsum())[starts])
        return signature

    def stay(
        self, joined: dict[int, Bool], loose: Bool, frame: int, earliest: int
    ) -> tuple[int, int]:
        """Around a frame: from when and until when nobody touches what hangs together, nor moves it.

        ``joined``: body → (T,) where it hangs together with the others; ``loose`` (T,) where the
        robot touches none of that. What has moved by less than ``STAYS`` has not.
        """
        key = tuple(joined)
        if key not in self._stacked:
            self._stacked[key] = self._poses(key, slice(None))
        place, turn = self._stacked[key]
        there = np.array(list(joined.values()))
        # half the angle is the arc between two quaternions
        return stays_for(place, turn, there, loose, frame, earliest, STAYS[0], STAYS[1] / 2)

    def stretches(
        self, pairs: Sequence[Pair], frames: NDArray[np.intp], part: NDArray[np.int32]
    ) -> NDArray[np.intp]:
        """(N,) for each of the frames (N,) the first of the stretch that it belongs to.

        The same pairs touch at all frames of one ``part`` (N,). Stretches end where it does, or
        bodies come to lie otherwise (``stretch_starts``).
        """
        begin, end = int(frames[0]), int(frames[-1]) + 1
        spans = {pair: self.starts(pair)[[begin, end]] for pair in pairs}
        touching = [pair for pair, (low, high) in spans.items() if low < high]
        bodies = sorted({body for pair in touching for body in pair})
        start, points = np.empty((len(touching), end - begin + 1), np.int64), [NOTHING]
        many = 0
        for row, pair in zip(start, touching, strict=True):
            low, high = spans[pair]
            points.append(self.points(pair, slice(low, high)))
            row[:] = self.starts(pair)[begin : end + 1] + (many - low)
            many += high - low
        position, normal, *_ = map(np.concatenate, zip(*points, strict=True))
        layout = Layout(
            *self._poses(bodies, slice(begin, end)),
            np.array([self.centre(body, slice(begin, end)) for body in bodies]),
            np.array([[bodies.index(body) for body in pair] for pair in touching]),
            start,
            position,
            normal,
        )
        first = np.empty(len(frames), np.int64)
        stretch_starts(layout, frames - begin, part, first)
        return first + begin

    def _poses(self, bodies: Sequence[int], frames: slice) -> tuple[F32, F32]:
        """(K, F, 3) m and (K, F, 4), as they are stored."""
        tracks = [self._episode.track(self._names[body]) for body in bodies]
        place = np.array([track.position[frames] for track in tracks])
        return place, np.array([track.orientation[frames] for track in tracks])

    def centre(self, body: int, frames: At) -> F64:
        """(F, 3) m, the body's centre of mass at some frames, world."""
        track = self._episode.track(self._names[body])
        offset = np.asarray(self._episode.header.bodies[body].com, np.float64)
        place = track.position[frames].astype(np.float64)
        return transform(place, track.orientation[frames], offset) if offset.any() else place


def _mixed(first: NDArray[np.int64], second: NDArray[np.int64]) -> NDArray[np.int64]:
    """A number that stands for a pair of geoms."""
    return np.asarray((first * 73856093 ^ second * 19349663) % 1000003 + 1)
