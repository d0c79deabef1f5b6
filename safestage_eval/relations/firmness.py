"""How firmly a body stands: who carries it, and how far it is from tipping."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.evidence.contact_sums import ContactSums
from safestage_eval.evidence.facts import Movers
from safestage_eval.evidence.intervals import Interval, exact
from safestage_eval.evidence.motion import com_position
from safestage_eval.geometry.footprint import outline_margin
from safestage_eval.geometry.polygon import polygon_margin
from safestage_eval.geometry.pose import angle

from .graph import LEAST_SHARE, SupportGraph

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

RISES = 0.5
"""A contact whose normal rises at least this much (60° from the vertical) is stood on."""
KEPT = 0.1
"""s for which a contact of a body that has not moved lasts when it is missing."""
STAYS, STAYS_TURN = 1e-3, np.radians(1.0)
"""m, rad: less is no motion, as for the relations of what nobody touches."""
PAIRS = 2_000_000
"""Pairs of contacts that are compared one by one."""


@dataclass(frozen=True)
class Points:
    """Where a body is supported.

    Attributes:
        position: (P, 3) m, world.
        owner: (P,) which of N frames each is at.
        few: (N,) no one of the frames that they are taken from has three: there may be more.
    """

    position: F64
    owner: I64
    few: Bool


@dataclass(frozen=True)
class Stance:
    """How a body stands at N frames: what its support margin and its tipping angle are made of.

    Attributes:
        margin: (N,) m, what it is at least; NaN where the support spans no area.
        most: (N,) m, what it is at most: the same where it is known; inf where nothing bounds it.
        spanned: (N,) m, the same by contacts alone, which tell the height of the support as well.
        height: (N,) m, of the COM above the support; NaN where it has none.
        notes: what is not known.
    """

    margin: F64
    most: F64
    spanned: F64
    height: F64
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Weight:
    """A body and all that rests on it: centre of mass (N, 3) m, world; what is not known of it."""

    centre: F64
    notes: tuple[str, ...]


class Loads:
    """Shares of the upward load, and the margin of the support polygon, from recorded contacts."""

    def __init__(
        self, episode: Episode, sums: ContactSums, graph: SupportGraph, movers: Movers
    ) -> None:
        """Nothing is computed before it is asked for."""
        self._episode = episode
        self._movers = movers
        self._sums = sums
        self._graph = graph
        self._names = [body.name for body in episode.header.bodies]
        self._gravity = float(np.linalg.norm(episode.header.gravity))
        self._com: dict[int, F64] = {}

    def share(self, body: int, by: int) -> Interval:
        """(T,) share of the upward forces on a body that another exerts; 0 where none bears it.

        Every other body counts towards the whole, the robot as well.
        """
        total = np.zeros(len(self._episode))
        for other in self._sums.beside(body):
            total += np.maximum(self._sums.upward(body, other), 0)
        part = np.zeros(len(self._episode))
        if by in self._sums.beside(body):
            part = np.maximum(self._sums.upward(body, by), 0)
        return exact(np.divide(part, total, out=np.zeros_like(part), where=total > 0), "ratio")

    def standing(self, body: int, at: I64) -> Stance:
        """How the body, with everything that rests on it, stands at some frames.

        A solver leaves out contacts of what rests for a few frames: as long as neither it nor what
        bears it has moved, contacts last for ``KEPT``. What they span together is what it stands on at
        least; where no frame has three, there may be more. Where all that it touches spans an area,
        that bounds the margin; so does what its outline shares with those of what it touches.
        """
        points, weight = self._points(body, at), self._weight(body, at)
        margin = polygon_margin(points.position[:, :2], points.owner, weight.centre[:, :2])
        many = np.bincount(points.owner, minlength=len(at))
        level = np.bincount(points.owner, points.position[:, 2], minlength=len(at))
        height = weight.centre[:, 2] - np.divide(
            level, many, out=np.full(len(at), np.nan), where=many > 0
        )
        margin = np.where(np.isnan(height), np.nan, margin)
        most, spanned, notes = margin.copy(), margin.copy(), weight.notes
        loose = np.isnan(margin) | points.few
        if loose.any():
            few = f"{self._names[body]} has fewer than three support contacts that span an area"
            notes = (*notes, few)
            points = self._touching(body, at[loose])
            centre = weight.centre[loose, :2]
            bound = polygon_margin(points.position[:, :2], points.owner, centre)
            bound = np.where(np.isnan(bound) | points.few, np.inf, bound)
            spanned[loose] = np.fmax(bound, margin[loose])
            bound = np.minimum(bound, self._outlined(body, at[loose], centre))
            most[loose] = np.fmax(bound, margin[loose])
        return Stance(margin, most, spanned, height, notes)

    def _unmoved(self, body: int, before: I64, now: I64) -> Bool:
        """(N,) the body and all that ever bears it are where they were at frames before."""
        same = np.ones(len(now), np.bool_)
        for other in (body, *self._graph.bearers(body)):
            track = self._episode.tracks[self._names[other]]
            if len(track) > 1:
                went = np.linalg.norm(track.position[before] - track.position[now], axis=1)
                same &= went <= STAYS
                same &= angle(track.orientation[before], track.orientation[now]) <= STAYS_TURN
        return same

    def _touching(self, body: int, at: I64) -> Points:
        """All its contacts, be it with what hardly presses on it; not those with the robot."""
        found: list[Sequence[Any]] = []
        for other in self._not_robot(body):
            pair = (min(other, body), max(other, body))
            found.append(self._episode.contacts.of_pair(pair, "frame", "position"))
        return self._lasting(body, at, found)

    def _not_robot(self, body: int) -> list[int]:
        """Bodies that ever touch a body, without the robot and its parts."""
        bodies, part = self._episode.header.bodies, self._graph.assemblies.on_robot
        beside = self._sums.beside(body)
        return [x for x in beside if bodies[x].kind not in ("robot", "gripper") and not part(x)]

    def _outlined(self, body: int, at: I64, centre: F64) -> F64:
        """(N,) m, what the margin is at most by the outlines of what it touched within ``KEPT``.

        inf where one of these has no shape.
        """
        most = np.full(len(at), np.inf)
        if not self._movers.of([self._names[body]]):
            return most
        others, t = self._not_robot(body), self._episode.t
        begin = np.searchsorted(t, t[at] - KEPT - 1e-9)
        touched = np.zeros((len(others), len(at)), np.bool_)
        for row, other in enumerate(others):
            pair = (min(other, body), max(other, body))
            (frame,) = self._episode.contacts.of_pair(pair, "frame")
            frame = np.sort(frame)
            touched[row] = frame.searchsorted(begin) < frame.searchsorted(at, side="right")
        for combination in np.unique(touched, axis=1).T:
            names = [self._names[x] for x, on in zip(others, combination, strict=True) if on]
            movers = self._movers.of(names)
            if names and len(movers) == len(names):
                here = (touched == combination[:, None]).all(axis=0)
                most[here] = outline_margin(
                    self._movers[self._names[body]], movers, at[here], centre[here]
                )
        return most

    def _points(self, body: int, at: I64) -> Points:
        """Contacts with what bears the body that are stood on or carry a share of its weight."""
        weight = (self._episode.header.bodies[body].mass or 0.0) * self._gravity
        found = []
        for bearer, bears in self._graph.bearers(body).items():
            pair = (min(bearer, body), max(bearer, body))
            frame, position, normal, force = self._episode.contacts.of_pair(
                pair, "frame", "position", "normal.z", "force.z"
            )
            sign = 1.0 if body > bearer else -1.0
            carries = (sign * normal >= RISES) | (sign * force >= max(LEAST_SHARE * weight, 1e-9))
            use = carries & bears[frame]
            found.append((frame[use], position[use]))
        return self._lasting(body, at, found)

    def _lasting(self, body: int, at: I64, found: Sequence[Sequence[Any]]) -> Points:
        """Contacts (frames, positions) at some frames, and those missing there that were there before.

        Within ``KEPT``, and while the body and what bears it have not moved; they go with the body by
        what that leaves. None is missing that has another within ``STAYS`` of it at the frame.
        """
        if not found:
            return Points(np.empty((0, 3)), np.empty(0, np.int64), np.ones(len(at), np.bool_))
        frame, position = (np.concatenate(part) for part in zip(*found, strict=True))
        order, t = np.argsort(frame, kind="stable"), self._episode.t
        frame, position = frame[order], position[order].astype(np.float64)
        begin = np.searchsorted(t, t[at] - KEPT - 1e-9)
        first = np.searchsorted(frame, begin)
        many = np.searchsorted(frame, at, side="right") - first
        owner = np.repeat(np.arange(len(at)), many)
        row = np.arange(len(owner)) + np.repeat(first - (np.cumsum(many) - many), many)
        there = frame[row] == at[owner]
        points, track = position[row], self._episode.tracks[self._names[body]]
        if len(track) > 1:
            points += (track.position[at[owner]] - track.position[frame[row]]).astype(np.float64)
        use = there.copy()
        use[~there] = _far(points[there], owner[there], points[~there], owner[~there])
        missing = np.flatnonzero(use & ~there)
        use[missing] = self._unmoved(body, frame[row[missing]], at[owner[missing]])
        found_at = np.bincount(frame, minlength=len(t) + 1)
        windows = np.column_stack([begin, at + 1]).ravel()
        few = np.maximum.reduceat(found_at, windows)[::2] < 3
        return Points(points[use], owner[use], few)

    def _weight(self, body: int, at: I64) -> Weight:
        """The common COM of the body and its load.

        What rests on nothing else counts with its whole mass; of what others (or the robot) bear
        as well, the force that it exerts on the body or its load counts, where it acts.
        """
        own = {x: inside for x, inside in self._resting(body, at).items() if inside.any()}
        bodies = self._episode.header.bodies
        unweighed = [bodies[x].name for x in own if bodies[x].mass is None]
        notes = (f"the trace has no mass of {', '.join(unweighed)}",) if unweighed else ()
        mass, moment = np.zeros(len(at)), np.zeros((len(at), 3))
        for x, inside in own.items():
            own_mass = bodies[x].mass
            m = np.where(inside, np.nan if own_mass is None else own_mass, 0.0)
            mass += m
            moment += m[:, None] * np.where(inside[:, None], self._centre(x)[at], 0.0)
        for x, inside in own.items():
            for other, bears in self._graph.load(x).items():
                partly = inside & bears[at] & ~own.get(other, np.zeros(len(at), np.bool_))
                if partly.any():
                    m, place = self._pressed(x, other, at)
                    mass += np.where(partly, m, 0.0)
                    moment += np.where(partly[:, None], m[:, None] * place, 0.0)
        with np.errstate(invalid="ignore"):
            return Weight(moment / mass[:, None], notes)

    def _resting(self, body: int, at: I64) -> dict[int, Bool]:
        """Body → (N,) where it is the given one, or rests on it and on nothing else."""
        above: dict[int, Bool] = {}
        todo = [body]
        while todo:
            y = todo.pop()
            for x, bears in {**self._graph.load(y), **self._graph.jointed(y)}.items():
                if x != body and x not in above and bears[at].any():
                    above[x] = ~self._graph.borne_by_robot(x)[at]
                    todo.append(x)
        own = {body: np.ones(len(at), np.bool_), **above}
        changed = True
        while changed:  # what is borne by something outside does not belong to it
            changed = False
            for x in above:
                borne = np.zeros(len(at), np.bool_)
                alone = own[x].copy()
                for s, bears in {**self._graph.bearers(x), **self._graph.jointed(x)}.items():
                    within = own.get(s, np.zeros(len(at), np.bool_))
                    borne |= bears[at] & within
                    alone &= ~bears[at] | within
                if (own[x] & ~(borne & alone)).any():
                    own[x] = borne & alone
                    changed = True
        return own

    def _pressed(self, under: int, by: int, at: I64) -> tuple[F64, F64]:
        """The load of one body on another: in kg (N,), and where it acts (N, 3) m."""
        frames = len(self._episode)
        pair = (min(under, by), max(under, by))
        frame, position, force = self._episode.contacts.of_pair(
            pair, "frame", "position", "force.z"
        )
        down = np.maximum((1.0 if by > under else -1.0) * force.astype(np.float64), 0.0)
        total = np.bincount(frame, down, minlength=frames)[at]
        place = np.stack(
            [np.bincount(frame, down * position[:, k], minlength=frames)[at] for k in range(3)], 1
        )
        place = np.divide(place, total[:, None], out=np.zeros_like(place), where=total[:, None] > 0)
        return total / self._gravity, np.asarray(place, np.float64)

    def _centre(self, body: int) -> F64:
        if body not in self._com:
            self._com[body] = com_position(self._episode, self._names[body])
        return self._com[body]


def _far(points: F64, owner: I64, others: F64, their_owner: I64) -> Bool:
    """(M,) which of the others have none of the points of the same owner within ``STAYS``.

    ``owner`` ascends.
    """
    far = np.ones(len(others), np.bool_)
    first = np.searchsorted(owner, their_owner)
    many = np.searchsorted(owner, their_owner, side="right") - first
    if many.sum() > PAIRS:
        return _far_of_many(points, owner, others, their_owner)
    other = np.repeat(np.arange(len(others)), many)
    point = np.arange(len(other)) + np.repeat(first - (np.cumsum(many) - many), many)
    x, y, z = (points[:, k].take(point) - others[:, k].take(other) for k in range(3))
    far[other[x * x + y * y + z * z < STAYS**2]] = (
        False  # six times as fast as along an axis of three
    )
    return far


def _far_of_many(points: F64, owner: I64, others: F64, their_owner: I64) -> Bool:
    """Like ``_firmness``, in little memory. Importing scipy takes as long as judging ten episodes."""
    from scipy.spatial import cKDTree

    apart = 2 * STAYS  # of owners, in a fourth direction
    tree = cKDTree(np.column_stack([points, apart * owner]))
    distance, _ = tree.query(
        np.column_stack([others, apart * their_owner]), distance_upper_bound=STAYS
    )
    return np.isinf(distance)
