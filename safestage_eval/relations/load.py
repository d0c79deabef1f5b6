"""How firmly a body stands: who carries it, and how far it is from tipping."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.geometry.stability import polygon_margin
from safestage_eval.signals.contact_sums import ContactSums
from safestage_eval.signals.motion import com_position
from safestage_eval.signals.series import Series, exact

from .graph import LEAST_SHARE, SupportGraph

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

RISES = 0.5
"""A contact whose normal rises at least this much (60° from the vertical) is stood on."""


@dataclass(frozen=True)
class Points:
    """Where a body is supported: points (P, 3) m, world, and which of N frames each is at (P,)."""

    position: F64
    owner: I64


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

    def standing(self, body: int, at: I64) -> tuple[F64, F64, tuple[str, ...]]:
        """Margin (N,) m and height of the COM above the support (N,) m at some frames; and notes.

        Both are of the body and everything that rests on it. NaN where they are not defined.
        """
        points = self._points(body, at)
        weight = self._weight(body, at)
        margin = polygon_margin(points.position[:, :2], points.owner, weight.centre[:, :2])
        notes = weight.notes
        if np.isnan(margin).any():
            few = f"{self._names[body]} has fewer than three support contacts that span an area"
            notes = (*notes, few)
        many = np.bincount(points.owner, minlength=len(at))
        level = np.bincount(points.owner, points.position[:, 2], minlength=len(at))
        height = weight.centre[:, 2] - np.divide(
            level, many, out=np.full(len(at), np.nan), where=many > 0
        )
        return np.where(np.isnan(height), np.nan, margin), height, notes

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
        """What one body presses down on another: in kg (N,), and where that acts (N, 3) m."""
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
