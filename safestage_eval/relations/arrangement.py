"""How bodies lie against each other, and from when on they lie differently."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.episode.contacts import Pair
from safestage_eval.geometry.lengths import near_first, near_for
from safestage_eval.geometry.pose import angle, matrix, relative
from safestage_eval.signals.contact_kernels import rows_by_frame
from safestage_eval.signals.motion import com_position

from .statics import ARM, LOST

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]

SHIFTED = LOST * ARM
"""m: a contact that moved by less changes no torque by more than the balance leaves open."""
TURNED = LOST
"""rad: likewise of a normal, a body, or one body as seen from another."""


class Arrangement:
    """The contacts that carry something, and stretches of frames over which they stay the same.

    A contact point without force (one within the simulator's margin, or between two physics steps)
    carries nothing.
    """

    def __init__(self, episode: Episode) -> None:
        """Nothing is computed before it is asked for."""
        self._episode = episode
        self._names = [body.name for body in episode.header.bodies]
        self._rows: dict[Pair, NDArray[np.intp]] = {}
        self._frames: dict[Pair, NDArray[np.int32]] = {}
        self._starts: dict[Pair, NDArray[np.intp]] = {}
        self._com: dict[int, F64] = {}
        self._layout: dict[Pair, F64] = {}

    def rows(self, pair: Pair) -> NDArray[np.intp]:
        """(N,) the pair's rows with a force, among its own, by frame."""
        if pair not in self._rows:
            frame, normal, force = self._episode.contacts.of_pair(pair, "frame", "normal", "force")
            self._rows[pair] = rows_by_frame(frame, force, normal, len(self._episode))
            self._frames[pair] = frame.take(self._rows[pair])
        return self._rows[pair]

    def frames(self, pair: Pair) -> NDArray[np.int32]:
        """(N,) the frame of each of these rows."""
        self.rows(pair)
        return self._frames[pair]

    def starts(self, pair: Pair) -> NDArray[np.intp]:
        """(T + 1,) the rows of frame t are ``rows[starts[t] : starts[t + 1]]``."""
        if pair not in self._starts:
            frames = len(self._episode)
            starts = self._starts[pair] = np.zeros(frames + 1, np.intp)
            np.cumsum(np.bincount(self.frames(pair), minlength=frames), out=starts[1:])
        return self._starts[pair]

    def touching(self, pair: Pair) -> Bool:
        """(T,) true where the pair has a row with a force."""
        starts = self.starts(pair)
        return np.asarray(starts[1:] > starts[:-1])

    def signature(self, pairs: Iterable[Pair]) -> NDArray[np.int64]:
        """(T,) equal where equal sets of contact points of the pairs carry something."""
        frames = len(self._episode)
        signature = np.zeros(frames, np.int64)
        for pair in pairs:
            geom1, geom2 = self._episode.contacts.of_pair(pair, "geom1", "geom2")
            if not len(geom1):
                continue
            if (geom1 == geom1[0]).all() and (geom2 == geom2[0]).all():  # one geom on each side
                signature += _mixed(geom1[0], geom2[0]) * np.diff(self.starts(pair))
                continue
            # whole numbers below 2⁵³ add up exactly in float64
            weights = _mixed(geom1, geom2)[self.rows(pair)]
            signature += np.bincount(self.frames(pair), weights, frames).astype(np.int64)
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
        self, pairs: Sequence[Pair], frames: NDArray[np.intp]
    ) -> Iterator[NDArray[np.intp]]:
        """Cut frames (N,) into stretches of which each is like its first.

        At all of them the same pairs touch. They lie differently once bodies have turned, or moved
        against each other, and contact points or normals moved with them: points alone jump about
        under what stands still, and bodies alone slide along what is flat.
        """
        first = int(frames[0])
        touching = [p for p in pairs if self.starts(p)[first] < self.starts(p)[first + 1]]
        while len(frames):
            alike = self._alike(touching, frames)
            yield frames[:alike]
            frames = frames[alike:]

    def _alike(self, pairs: Sequence[Pair], frames: NDArray[np.intp]) -> int:
        """How many of the frames (N,), from the first on, are like the first."""
        done, step = max(1, self._stay_for(pairs, frames)), 16
        while done < len(frames):
            some = frames[np.concatenate([[0], np.arange(done, min(done + step, len(frames)))])]
            moved = self._moved(pairs, some)
            if moved.any():
                moved &= self._rearranged(pairs, some)
            if moved.any():
                return done - 1 + int(moved.argmax())
            done, step = done + step, step * 4
        return len(frames)

    def centre(self, body: int) -> F64:
        """(T, 3) m, the body's centre of mass, world."""
        if body not in self._com:
            self._com[body] = com_position(self._episode, self._names[body])
        return self._com[body]

    def _moved(self, pairs: Iterable[Pair], frames: NDArray[np.intp]) -> Bool:
        """(N,) some body leans otherwise than at the first frame, or lies otherwise on another."""
        moved = np.zeros(len(frames), np.bool_)
        stays = {body: self._stays(body, frames) for pair in pairs for body in pair}
        for pair in pairs:
            some = np.flatnonzero(~(stays[pair[0]] & stays[pair[1]]))
            if not len(some):
                continue
            at = frames[np.concatenate([[0], some])]
            tracks = [self._episode.track(self._names[body]) for body in pair]
            (p, q), (r, s) = ((t.position[at], t.orientation[at]) for t in tracks)
            place, turn = relative(p, q, r, s)
            found = np.linalg.norm(place - place[0], axis=1) > SHIFTED
            found |= angle(turn, turn[0]) > TURNED
            for orientation in (q, s):
                upward = matrix(orientation)[:, 2]
                found |= np.linalg.norm(upward - upward[0], axis=1) > TURNED
            moved[some] |= found[1:]
        return moved

    def _stay_for(self, pairs: Iterable[Pair], frames: NDArray[np.intp]) -> int:
        """For how many of the frames (N,), from the first on, ``_stays`` is true of all bodies."""
        for body in {body for pair in pairs for body in pair}:
            track = self._episode.tracks[self._names[body]]
            if len(track) > 1:
                frames = frames[: near_for(track.position, frames, SHIFTED / 4)]
                frames = frames[: near_for(track.orientation, frames, TURNED / 40)]
        return len(frames)

    def _stays(self, body: int, frames: NDArray[np.intp]) -> Bool:
        """(N,) it is where it was at the first frame: too near to matter, whatever the other does."""
        stays = np.ones(len(frames), np.bool_)
        track = self._episode.tracks[self._names[body]]
        if len(track) == 1:  # it never moves
            return stays
        for values, room in ((track.position, SHIFTED / 4), (track.orientation, TURNED / 40)):
            stays &= near_first(values, frames, room)
        return stays

    def _rearranged(self, pairs: Iterable[Pair], frames: NDArray[np.intp]) -> Bool:
        """(N,) contact points or normals of some pair are elsewhere than at the first frame."""
        moved = np.zeros(len(frames), np.bool_)
        for pair in pairs:
            change = np.abs(self._laid_out(pair)[frames] - self._laid_out(pair)[frames[0]])
            moved |= (change > 1.0).any(axis=1)
        return moved

    def _laid_out(self, pair: Pair) -> F64:
        """(T, 15) mean point from both centres of mass, mean normal, and spread of the points.

        Each in units of what makes a difference.
        """
        if pair not in self._layout:
            frames = len(self._episode)
            point, normal = self._episode.contacts.of_pair(pair, "position", "normal")
            rows, frame = self.rows(pair), self.frames(pair)
            point, normal = point[rows].astype(np.float64), normal[rows].astype(np.float64)
            many = np.maximum(np.bincount(frame, minlength=frames), 1)

            def mean(values: F64) -> F64:
                return (
                    np.stack([np.bincount(frame, v, frames) for v in values.T], 1) / many[:, None]
                )

            middle = mean(point)
            out = point - middle[frame]
            spread = mean(np.stack([out[:, i] * out[:, j] for i, j in _AXES], 1))
            size = np.sqrt(spread[:, :3].sum(1, keepdims=True))
            self._layout[pair] = np.concatenate(
                [
                    *((middle - self.centre(body)) / SHIFTED for body in pair),
                    mean(normal) / TURNED,
                    spread / (SHIFTED * np.maximum(size, SHIFTED)),
                ],
                axis=1,
            )
        return self._layout[pair]


def _mixed(geom1: NDArray[np.uint16], geom2: NDArray[np.uint16]) -> NDArray[np.int64]:
    """A number that stands for a pair of geoms."""
    mixed = geom1.astype(np.int64) * 73856093 ^ geom2.astype(np.int64) * 19349663
    return np.asarray(mixed % 1000003 + 1)


_AXES = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
