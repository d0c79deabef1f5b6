"""How firmly a body stands: who carries it, and how far it is from tipping."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.evidence.contact_sums import ContactSums
from safestage_eval.evidence.motion import com_position
from safestage_eval.evidence.series import Series, exact
from safestage_eval.geometry.pose import angle
from safestage_eval.geometry.stability import polygon_margin

from .graph import LEAST_SHARE, SupportGraph

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

RISES = 0.5
"""A contact whose normal rises at least this much (60° from the vertical) is stood on."""
KEPT = 0.1
"""s for which a body that has not moved stands on what it stood on, whatever contacts are missing."""
STAYS, STAYS_TURN = 1e-3, np.radians(1.0)
"""m, rad: less is no motion, as for the relations of what nobody touches."""


@dataclass(frozen=True)
class Points:
    """Where a body is supported: points (P, 3) m, world, and which of N frames each is at (P,)."""

    position: F64
    owner: I64


@dataclass(frozen=True)
class Stance:
    """How a body stands at N frames: what its support margin and its tipping angle are made of.

    Attributes:
        margin: (N,) m; NaN where the support spans no area.
        most: (N,) m, what the margin is at most: itself where it is known; inf where nothing is.
        height: (N,) m, of the COM above the support; NaN where it has none.
        notes: what is not known.
    """

    margin: F64
    most: F64
    height: F64
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Weight:
    """A body and all that rests on it: centre of mass (N, 3) m, world; what is not known of it."""

    centre: F64
    notes: tuple[str, ...]


class Loads:
    """Shares of the upward load, and the margin of the support polygon, from recorded contacts."""

    def __init__(self, episode: Episode, sums: ContactSums, graph: SupportGraph) -> None:
        """Nothing is computed before it is asked for."""
        self._episode = episode
        self._sums = sums
        self._graph = graph
        self._names = [body.name for body in episode.header.bodies]
        self._gravity = float(np.linalg.norm(episode.header.gravity))
        self._com: dict[int, F64] = {}

    def share(self, body: int, by: int) -> Series:
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

        A solver leaves out contacts of what rests on two edges for a few frames: as long as neither it
        nor what bears it has moved for ``KEPT``, it stands as it did. Where all that it touches
        spans an area, though what bears it spans none, that area bounds the margin.
        """
        margin, height, notes = self._stance(body, at)
        lost = np.flatnonzero(np.isnan(margin))
        before = self._before(at[lost])
        kept, above, _ = self._stance(body, before)
        last = self._last(before[~np.isnan(kept)], at[lost])
        same = (last >= 0) & self._unmoved(body, np.maximum(last, 0), at[lost])
        source = np.searchsorted(before, last[same])
        margin[lost[same]], height[lost[same]] = kept[source], above[source]
        nothing = np.isnan(margin)
        most = margin.copy()
        if nothing.any():
            few = f"{self._names[body]} has fewer than three support contacts that span an area"
            notes = (*notes, few)
            points, weight = self._touching(body, at[nothing]), self._weight(body, at[nothing])
            bound = polygon_margin(points.position[:, :2], points.owner, weight.centre[:, :2])
            most[nothing] = np.where(np.isnan(bound), np.inf, bound)
        return Stance(margin, most, height, notes)

    def _stance(self, body: int, at: I64) -> tuple[F64, F64, tuple[str, ...]]:
        """Margin (N,) m and height (N,) m from the contacts at the frames alone; NaN; and notes."""
        points, weight = self._points(body, at), self._weight(body, at)
        margin = polygon_margin(points.position[:, :2], points.owner, weight.centre[:, :2])
        many = np.bincount(points.owner, minlength=len(at))
        level = np.bincount(points.owner, points.position[:, 2], minlength=len(at))
        height = weight.centre[:, 2] - np.divide(
            level, many, out=np.full(len(at), np.nan), where=many > 0
        )
        return np.where(np.isnan(height), np.nan, margin), height, weight.notes

    def _before(self, at: I64) -> I64:
        """(M,) all frames within ``KEPT`` before some frames."""
        t = self._episode.t
        first = np.searchsorted(t, t[at] - KEPT - 1e-9)
        wanted = np.zeros(len(t) + 1, np.int64)
        np.add.at(wanted, first, 1)
        np.add.at(wanted, at, -1)
        return np.flatnonzero(np.cumsum(wanted)[:-1] > 0)

    def _last(self, usable: I64, at: I64) -> I64:
        """(N,) the last of some frames within ``KEPT`` before each; −1 if there is none."""
        if not len(usable):
            return np.full(len(at), -1, np.int64)
        place = np.searchsorted(usable, at) - 1
        last = np.where(place >= 0, usable[np.maximum(place, 0)], -1)
        late = self._episode.t[at] - self._episode.t[np.maximum(last, 0)] > KEPT + 1e-9
        return np.where(late, -1, last)

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
        where = np.full(len(self._episode), -1, np.int64)
        where[at] = np.arange(len(at))
        positions, owners = [np.empty((0, 3))], [np.empty(0, np.int64)]
        for other in self._sums.beside(body):
            robot = self._episode.header.bodies[other].kind in ("robot", "gripper")
            if robot or self._graph.assemblies.on_robot(other):
                continue
            pair = (min(other, body), max(other, body))
            frame, position = self._episode.contacts.of_pair(pair, "frame", "position")
            use = where[frame] >= 0
            positions.append(position[use].astype(np.float64))
            owners.append(where[frame[use]])
        return Points(np.concatenate(positions), np.concatenate(owners))

    def _points(self, body: int, at: I64) -> Points:
        """Contacts with what bears the body that are stood on or carry a share of its weight."""
        where = np.full(len(self._episode), -1, np.int64)
        where[at] = np.arange(len(at))
        weight = (self._episode.header.bodies[body].mass or 0.0) * self._gravity
        positions, owners = [np.empty((0, 3))], [np.empty(0, np.int64)]
        for bearer, bears in self._graph.bearers(body).items():
            pair = (min(bearer, body), max(bearer, body))
            frame, position, normal, force = self._episode.contacts.of_pair(
                pair, "frame", "position", "normal.z", "force.z"
            )
            sign = 1.0 if body > bearer else -1.0
            carries = (sign * normal >= RISES) | (sign * force >= max(LEAST_SHARE * weight, 1e-9))
            use = carries & bears[frame] & (where[frame] >= 0)
            positions.append(position[use].astype(np.float64))
            owners.append(where[frame[use]])
        return Points(np.concatenate(positions), np.concatenate(owners))

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
