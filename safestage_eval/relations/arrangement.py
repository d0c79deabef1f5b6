"""How bodies lie against each other, and from when on they lie differently."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.episode.contacts import Pair
from safestage_eval.geometry.lengths import near_for
from safestage_eval.signals.contact_kernels import rows_by_frame
from safestage_eval.signals.motion import com_position

from .near import NOTHING, Patch
from .shifts import Layout, stretch_starts

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]


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
        self._friction = np.array([g.friction[0] for body in bodies for g in body.geoms])
        self._rows: dict[Pair, NDArray[np.intp]] = {}
        self._starts: dict[Pair, NDArray[np.intp]] = {}
        self._points: dict[Pair, Patch] = {}
        self._com: dict[int, F64] = {}

    def points(self, pair: Pair) -> Patch:
        """The pair's contact points with a force, by frame."""
        if pair not in self._points:
            position, normal, force = self._episode.contacts.of_pair(
                pair, "position", "normal", "force"
            )
            rows = self._of(pair)
            rough = np.maximum(*(self._friction[geom] for geom in self._geoms(pair)))
            self._points[pair] = Patch(
                position[rows].astype(np.float64),
                normal[rows].astype(np.float64),
                np.broadcast_to(rough, len(rows)),
                force[rows].astype(np.float64),
            )
        return self._points[pair]

    def starts(self, pair: Pair) -> NDArray[np.intp]:
        """(T + 1,) the points of frame t are ``points[starts[t] : starts[t + 1]]``."""
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
        found = []
        for body, column in zip(pair, ("geom1", "geom2"), strict=True):
            first, end = self._first_geom[body : body + 2]
            if end - first == 1:
                found.append(np.array([first], np.int64))
            else:
                (geoms,) = self._episode.contacts.of_pair(pair, column)
                found.append(geoms[self._of(pair)].astype(np.int64))
        return found

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

    def stay_for(self, body: int, frames: NDArray[np.intp], shift: float, turn: float) -> int:
        """For how many of the frames (N,), from the first on, it moves and turns by no more."""
        track = self._episode.tracks[self._names[body]]
        if len(track) == 1:
            return len(frames)
        stays = near_for(track.position, frames, shift)
        # half the angle is the arc between two quaternions
        return min(stays, near_for(track.orientation, frames, turn / 2))

    def stretches(
        self, pairs: Sequence[Pair], frames: NDArray[np.intp], part: NDArray[np.int32]
    ) -> NDArray[np.intp]:
        """(N,) for each of the frames (N,) the first of the stretch that it belongs to.

        The same pairs touch at all frames of one ``part`` (N,). Stretches end where it does, or
        bodies come to lie otherwise (``stretch_starts``).
        """
        touching = [
            pair
            for pair in pairs
            if (self.starts(pair)[frames + 1] > self.starts(pair)[frames]).any()
        ]
        bodies = sorted({body for pair in touching for body in pair})
        first = np.empty(len(frames), np.int64)
        stretch_starts(self._lay_out(touching, bodies), frames, part, first)
        return first

    def _lay_out(self, pairs: list[Pair], bodies: list[int]) -> Layout:
        size = (len(bodies), len(self._episode))
        place, turn = np.empty((*size, 3), np.float32), np.empty((*size, 4), np.float32)
        centre = np.empty((*size, 3))
        for k, body in enumerate(bodies):
            track = self._episode.tracks[self._names[body]]
            place[k], turn[k], centre[k] = track.position, track.orientation, self.centre(body)
        sides = [[bodies.index(body) for body in pair] for pair in pairs]
        start, points = np.empty((len(pairs), size[1] + 1), np.int64), [NOTHING]
        for p, pair in enumerate(pairs):
            start[p] = sum(len(patch.normal) for patch in points) + self.starts(pair)
            points.append(self.points(pair))
        position, normal, *_ = map(np.concatenate, zip(*points, strict=True))
        both = np.array(sides, np.int64).reshape(-1, 2)
        return Layout(place, turn, centre, both, start, position, normal)

    def centre(self, body: int) -> F64:
        """(T, 3) m, the body's centre of mass, world."""
        if body not in self._com:
            self._com[body] = com_position(self._episode, self._names[body])
        return self._com[body]


def _mixed(first: NDArray[np.int64], second: NDArray[np.int64]) -> NDArray[np.int64]:
    """A number that stands for a pair of geoms."""
    return np.asarray((first * 73856093 ^ second * 19349663) % 1000003 + 1)
