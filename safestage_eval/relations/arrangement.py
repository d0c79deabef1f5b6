"""How free bodies lie against each other, frame by frame, and over which frames they lie alike."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode, Geom
from safestage_eval.episode.body import IDENTITY
from safestage_eval.episode.contacts import Pair
from safestage_eval.episode.runs import runs
from safestage_eval.geometry.pose import matrix

from .graph import Assemblies
from .near import NOTHING, Patch
from .statics import ARM, LOST, Pile

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

STAYS, STAYS_TURN = 1e-3, np.radians(1.0)
"""m, rad: what nobody touches and what has moved by less hangs together as it did."""
SHIFTED = LOST * ARM
"""m: a contact that moved by less changes no torque by more than the balance leaves open."""
TURNED = LOST
"""rad: likewise of a body, or one body as seen from another."""
AHEAD = 64
"""Frames that are compared at once."""


class Rows(NamedTuple):
    """A pair's contact points with a force: those of frame t are start[t] … start[t + 1]."""

    start: I64
    patch: Patch


class Recording:
    """Contact points, poses and masses as they were recorded; bodies are indices into ``header.bodies``."""

    def __init__(self, episode: Episode, assemblies: Assemblies) -> None:
        """Nothing is read before it is asked for."""
        self.episode, self.assemblies = episode, assemblies
        self.frames = len(episode)
        self._bodies = episode.header.bodies
        rough = [geom.friction[0] for body in self._bodies for geom in body.geoms]
        # the last is of a geom that the header does not have
        self._friction = np.array([*rough, Geom.model_fields["friction"].default[0]])
        self._rows: dict[Pair, Rows] = {}
        self._poses: dict[int, tuple[F64, F64]] = {}

    def rows(self, pair: Pair) -> Rows:
        """A pair's contact points that carry something.

        One without force (within the simulator's margin, or between two physics steps) does not. Of two
        geoms in contact the greater friction counts, as in MuJoCo.
        """
        if pair not in self._rows:
            frame, position, normal, force, *geoms = self.episode.contacts.of_pair(
                pair, "frame", "position", "normal", "force", "geom1", "geom2"
            )
            carries = np.flatnonzero((normal * force).sum(axis=1))
            some = carries[np.argsort(frame[carries], kind="stable")]
            last = len(self._friction) - 1
            rough = [self._friction[np.minimum(geom[some], last)] for geom in geoms]
            vectors = (values[some].astype(np.float64) for values in (position, normal, force))
            at, directed, pressed = vectors
            self._rows[pair] = Rows(
                np.searchsorted(frame[some], np.arange(self.frames + 1)),
                Patch(at, directed, np.maximum(*rough), pressed),
            )
        return self._rows[pair]

    def count(self, pair: Pair) -> I64:
        """(T,) how many of the pair's contact points carry something."""
        return np.diff(self.rows(pair).start)

    def points(self, pair: Pair, frame: int) -> Patch:
        """Those at a frame."""
        start, patch = self.rows(pair)
        return Patch(*(values[start[frame] : start[frame + 1]] for values in patch))

    def pose(self, body: int) -> tuple[F64, F64]:
        """(T, 3) m and (T, 3, 3), or one of each of a body that never moves."""
        if body not in self._poses:
            track = self.episode.track(self._bodies[body].name)
            self._poses[body] = track.position.astype(np.float64), matrix(track.orientation)
        return self._poses[body]

    def stays(self, body: int, then: int, frames: slice) -> Bool:
        """(F,) whether at some frames a body is where it was at another."""
        track = self.episode.track(self._bodies[body].name)
        if len(track) == 1:
            return np.ones(frames.stop - frames.start, np.bool_)
        way = np.abs(track.position[frames] - track.position[then]).max(axis=1)
        turn = np.abs(track.orientation[frames] - track.orientation[then]).max(axis=1)
        return np.asarray((way <= STAYS) & (turn <= STAYS_TURN / 2))

    def pile(
        self, heads: Sequence[int], contacts: Sequence[tuple[Pair, Patch]], frame: int
    ) -> Pile:
        """The objects that ``heads`` stand for, and contacts, at a frame.

        The parts of an object that are jointed together are one rigid body.
        """
        number = {part: k for k, head in enumerate(heads) for part in self.assemblies.of(head)}
        mass, centre, inertia = zip(*(self._object(head, frame) for head in heads), strict=True)
        owners = [[number.get(b, -1) for b in pair] for pair, p in contacts for _ in p.friction]
        patches = [NOTHING, *(patch for _, patch in contacts)]
        position, normal, friction, _ = map(np.concatenate, zip(*patches, strict=True))
        first, second = np.array(owners, np.int64).reshape(-1, 2).T
        objects = np.array(mass), np.array(centre), np.array(inertia)
        return Pile(*objects, first, second, position, normal, friction)

    def _object(self, head: int, frame: int) -> tuple[float, F64, F64]:
        """Mass (kg), centre (3,) m and inertia (3, 3) kg m² about it of an object."""
        parts = [
            self._part(p, frame) for p in sorted(self.assemblies.of(head) & self.assemblies.free)
        ]
        mass = sum(m for m, _, _ in parts)
        centre = sum((m * at for m, at, _ in parts), np.zeros(3)) / mass
        inertia = np.zeros((3, 3))
        for m, at, own in parts:
            arm = at - centre
            inertia += own + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        return mass, centre, inertia

    def _part(self, body: int, frame: int) -> tuple[float, F64, F64]:
        about, (place, turn) = self._bodies[body], self.pose(body)
        at, turned = place[frame % len(place)], turn[frame % len(turn)]
        mass = max(about.mass or 0.0, 1e-9)
        inertia = mass * ARM**2 * np.eye(3)
        if about.inertia is not None and min(about.inertia) > 0:
            axes = turned
            if tuple(about.inertia_orientation) != IDENTITY:
                axes = turned @ matrix(np.asarray(about.inertia_orientation))
            inertia = (axes * about.inertia) @ axes.T
        return mass, at + turned @ np.asarray(about.com, np.float64), inertia


class Cluster:
    """The free bodies that contacts ever join to one, and all that touches them.

    Attributes:
        free: those bodies.
        pairs: of bodies that touch, at least one of them free.
    """

    def __init__(self, recording: Recording, free: set[int], pairs: Sequence[Pair]) -> None:
        """Nothing is computed before it is asked for."""
        self._recording, self.free, self.pairs = recording, sorted(free), list(pairs)
        self._robot = recording.assemblies.robot
        self._row = {body: k for k, body in enumerate(self.free)}
        self._stretches: dict[int, I64] = {}
        self._seen: dict[Pair, F64] = {}

    @cached_property
    def count(self) -> I64:
        """(P, T) how many points of each pair carry something."""
        found = [self._recording.count(pair) for pair in self.pairs]
        return np.array(found, np.int64).reshape(-1, self._recording.frames)

    @cached_property
    def touching(self) -> Bool:
        """(P, T) the pair touches.

        Contacts of what rests are missing at times: they last as long as both bodies stay where they
        were, and the robot touches neither.
        """
        touching = self.count > 0
        handled = {body: np.zeros(self._recording.frames, np.bool_) for body in self.free}
        for p, pair in enumerate(self.pairs):
            if not self._robot.isdisjoint(pair):
                for body in set(pair) & handled.keys():
                    handled[body] |= touching[p]
        for p, pair in enumerate(self.pairs):
            if self._robot.isdisjoint(pair) and touching[p].any():
                hands = [handled[body] for body in pair if body in handled]
                touching[p] = self._lasting(pair, touching[p], np.logical_or.reduce(hands))
        return touching

    def _lasting(self, pair: Pair, touching: Bool, handled: Bool) -> Bool:
        """(T,) the pair touches, or did before or will later and nothing happens until then."""
        out = touching.copy()
        for begin, end in runs(~touching):
            for at, way in ((begin - 1, 1), (end, -1)):
                if 0 <= at < len(out):
                    stays = ~handled[begin:end]
                    for body in pair:
                        stays &= self._recording.stays(body, at, slice(begin, end))
                    long = int(np.append(stays[::way], False).argmin())
                    out[slice(begin, begin + long) if way > 0 else slice(end - long, end)] = True
        return out

    @cached_property
    def label(self) -> I64:
        """(K, T) equal for bodies that a chain of contacts, or of joints, joins at a frame."""
        label = np.repeat(np.arange(len(self.free))[:, None], self._recording.frames, axis=1)
        links = [
            (self._row[i], self._row[j], self.touching[p])
            for p, (i, j) in enumerate(self.pairs)
            if i in self._row and j in self._row
        ]
        for body in self.free:
            parts = self._recording.assemblies.of(body) & self._row.keys()
            links += [(self._row[body], self._row[part], np.True_) for part in parts]
        changed = True
        while changed:  # at most as many rounds as the longest chain has bodies
            before = label.copy()
            for i, j, joined in links:
                least = np.minimum(label[i], label[j])
                label[i] = np.where(joined, least, label[i])
                label[j] = np.where(joined, least, label[j])
            changed = not np.array_equal(before, label)
        return np.asarray(label)

    def joined(self, body: int) -> Bool:
        """(K, T) the bodies that hang together with one."""
        return np.asarray(self.label == self.label[self._row[body]])

    def linked(self, body: int, on: Iterable[int]) -> Bool:
        """(T,) a chain of contacts among free bodies leads from one to some of the others."""
        joined, out = self.joined(body), np.zeros(self._recording.frames, np.bool_)
        for other in on:
            if other in self._row:
                out |= joined[self._row[other]]
            else:
                for p, pair in enumerate(self.pairs):
                    if other in pair:
                        out |= self.touching[p] & joined[self._row[sum(pair) - other]]
        return out

    def stretch(self, body: int) -> I64:
        """(T,) the first frame of the stretch that each frame belongs to.

        Over a stretch the same bodies hang together with a body by the same pairs that touch, and
        none leans otherwise, or lies otherwise on another.
        """
        if body not in self._stretches:
            joined, first = self.joined(body), np.zeros(self._recording.frames, np.int64)
            there = self.touching.copy()
            for p, pair in enumerate(self.pairs):
                there[p] &= joined[self._row[next(b for b in pair if b in self._row)]]
            key = np.packbits(there, axis=0)
            cuts = np.flatnonzero((key[:, 1:] != key[:, :-1]).any(axis=0)) + 1
            for begin, end in pairwise([0, *cuts.tolist(), len(first)]):
                pairs = [q for q, on in zip(self.pairs, there[:, begin], strict=True) if on]
                bodies = [b for b in self.free if joined[self._row[b], begin]]
                first[begin:end] = begin + self._alike(bodies, pairs, slice(begin, end))
            self._stretches[body] = first
        return self._stretches[body]

    def _alike(self, bodies: list[int], pairs: list[Pair], at: slice) -> I64:
        """(F,) the first of the frames from which on bodies lie on each other as at that frame."""
        lies = [self._leans(body)[at] for body in bodies]
        lies += [self._lies(pair)[at] for pair in pairs if self._robot.isdisjoint(pair)]
        values = np.concatenate(lies, axis=1)
        first = np.zeros(len(values), np.int64)
        begin, ahead = 0, 1
        while begin + ahead < len(values):
            apart = np.abs(values[begin + ahead : begin + ahead + AHEAD] - values[begin]).max(
                axis=1
            )
            if (apart > 1).any():
                ahead += int(np.argmax(apart > 1))
                first[begin + ahead :] = begin = begin + ahead
                ahead = 1
            else:
                ahead += len(apart)
        return first

    def _leans(self, body: int) -> F64:
        """(T, 3) the vertical as a body sees it, in units of what makes a difference."""
        _, turn = self._recording.pose(body)
        return np.broadcast_to(turn[:, 2] / TURNED, (self._recording.frames, 3))

    def _lies(self, pair: Pair) -> F64:
        """(T, 12) where the second body is, and how it is turned, as the first sees it; likewise."""
        if pair not in self._seen:
            (place, turn), (to, turned) = map(self._recording.pose, pair)
            eye = turn.swapaxes(1, 2)
            where = (eye @ (to - place)[..., None])[..., 0] / SHIFTED
            how = (eye @ turned).reshape(-1, 9) / TURNED
            found = self._seen[pair] = np.empty((self._recording.frames, 12))
            found[:, :3], found[:, 3:] = where, how
        return self._seen[pair]

    def usual(self, frames: I64) -> int:
        """Of some frames, the first of those at which as many points carry something as at most of them.

        Frames at which fewer pairs touch than at others are left out.
        """
        count = self.count[:, frames]
        pairs = (count > 0).sum(axis=0)
        whole = np.flatnonzero(pairs == pairs.max())
        mixed = np.random.default_rng(0).integers(1, 2**40, len(count)) @ count[:, whole]
        _, place, many = np.unique(mixed, return_index=True, return_counts=True)
        return int(frames[whole[place[many.argmax()]]])
