"""How bodies lie against each other, and from when on they lie differently."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.episode.contacts import Pair
from safestage_eval.signals.contact_kernels import rows_by_frame
from safestage_eval.signals.motion import com_position

from .near import NOTHING, Patch
from .shifts import Layout, stays_for, stretch_starts

Bool = NDArray[np.bool_]
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]


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
        self._friction = np.array([g.friction[0] for body in bodies for g in body.geoms])
        self._rows: dict[Pair, NDArray[np.intp]] = {}
        self._starts: dict[Pair, NDArray[np.intp]] = {}
        self._points: dict[Pair, Patch] = {}
        self._com: dict[int, F64] = {}
        self._stacked: dict[tuple[int, ...], tuple[F32, F32]] = {}

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

    def stay(
        self, joined: dict[int, Bool], loose: Bool, frame: int, earliest: int
    ) -> tuple[int, int]:
        """Around a frame: from when and until when nobody touches what hangs together, nor moves it.

        ``joined``: body → (T,) where it hangs together with the others; ``loose`` (T,) where the
        robot touches none of that. What has moved by less than ``STAYS`` has not.
        """
        place, turn = self._poses(tuple(joined))
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
        touching = [pair for pair in pairs if np.diff(self.starts(pair)[[begin, end]])]
        bodies = tuple(sorted({body for pair in touching for body in pair}))
        spans = [slice(*self.starts(pair)[[begin, end]]) for pair in touching]
        points = [
            Patch(*(v[at] for v in self.points(p))) for p, at in zip(touching, spans, strict=True)
        ]
        position, normal, *_ = map(np.concatenate, zip(*points, NOTHING, strict=True))
        start, many = np.empty((len(touching), end - begin + 1), np.int64), 0
        for row, pair, span in zip(start, touching, spans, strict=True):
            row[:] = self.starts(pair)[begin : end + 1] + (many - span.start)
            many += span.stop - span.start
        layout = Layout(
            *(np.ascontiguousarray(v[:, begin:end]) for v in self._poses(bodies)),
            np.array([self.centre(body)[begin:end] for body in bodies]),
            np.array([[bodies.index(body) for body in pair] for pair in touching]),
            start,
            position,
            normal,
        )
        first = np.empty(len(frames), np.int64)
        stretch_starts(layout, frames - begin, part, first)
        return first + begin

    def _poses(self, bodies: tuple[int, ...]) -> tuple[F32, F32]:
        """(K, T, 3) m and (K, T, 4), as they are stored."""
        if bodies not in self._stacked:
            size = (len(bodies), len(self._episode))
            place, turn = np.empty((*size, 3), np.float32), np.empty((*size, 4), np.float32)
            for k, body in enumerate(bodies):
                track = self._episode.tracks[self._names[body]]
                place[k], turn[k] = track.position, track.orientation
            self._stacked[bodies] = place, turn
        return self._stacked[bodies]

    def centre(self, body: int) -> F64:
        """(T, 3) m, the body's centre of mass, world."""
        if body not in self._com:
            self._com[body] = com_position(self._episode, self._names[body])
        return self._com[body]


def _mixed(first: NDArray[np.int64], second: NDArray[np.int64]) -> NDArray[np.int64]:
    """A number that stands for a pair of geoms."""
    return np.asarray((first * 73856093 ^ second * 19349663) % 1000003 + 1)
