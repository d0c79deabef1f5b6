"""Dependence by statics: would this body fall if that one were taken away?"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.episode.contacts import Pair
from safestage_eval.signals.contact_sums import ContactSums

from .arrangement import Arrangement
from .graph import SupportGraph
from .statics import balanced

Bool = NDArray[np.bool_]

Contacts = dict[Pair, NDArray[np.intp]]
"""Pair → its rows at one frame, among the pair's own."""


class Dependence:
    """The collapse set of removing a body, from recorded contacts.

    Take a body away. Another falls if gravity on it *and all it carries* can no longer be balanced
    by forces within the friction cones of the contacts that remain (a linear feasibility problem:
    Baraff, "Coping with friction for non-penetrating rigid body simulation", 1991; Boyd &
    Vandenberghe, "Convex Optimization", 2004, sec. 11.4 for the phase-I form used). What fell is
    taken away too, until nothing more falls, so the top of a stack of three depends on its bottom.
    Contacts with the robot count as contacts that can hold; those without force do not. Of two geoms
    in contact the greater friction counts, as in MuJoCo. The parts of an object that are jointed
    together (a jar and its lid) stand and fall together.
    """

    def __init__(self, episode: Episode, sums: ContactSums, graph: SupportGraph) -> None:
        """Nothing is computed before it is asked for."""
        self._episode = episode
        self._sums = sums
        self._graph = graph
        header = episode.header
        self._mass = [body.mass or 0.0 for body in header.bodies]
        self._parts = graph.assemblies.of
        self._free = graph.assemblies.free
        self._robot = graph.assemblies.robot  # an immobile base counts as a fixture
        self._friction = np.array([g.friction[0] for b in header.bodies for g in b.geoms])
        self._arrangement = Arrangement(episode)
        self._clusters: dict[int, list[Pair]] = {}
        self._cuts: dict[int, NDArray[np.int64]] = {}
        self._falls: dict[tuple[int, int], frozenset[int]] = {}

    def beside(self, body: int) -> set[str]:
        """Names of the free bodies that contacts among free bodies ever join to the given one."""
        near = {body, *(b for pair in self._cluster(body) for b in pair)} & self._free
        return {self._episode.header.bodies[b].name for b in near}

    def depends_on(self, body: int, on: int, wanted: Bool | None = None) -> Bool:
        """(T,) true where ``body`` is in the collapse set of removing ``on``.

        Evaluated anew where the contact points of the bodies that hang together with ``on`` changed
        or moved by what makes a difference, and kept between. Only the ``wanted`` frames (T,) of the
        answer mean anything; all of them if None.
        """
        out = np.zeros(len(self._episode), np.bool_)
        linked = self._linked(body, on)
        asked = linked if wanted is None else linked & wanted
        if not asked.any():
            return out
        pairs = self._cluster(on)
        starts, frames_asked = self._segments(on), np.flatnonzero(asked)
        segments = np.searchsorted(starts, frames_asked, side="right") - 1
        for segment in np.unique(segments):
            first, stop = starts[segment], starts[segment + 1]
            # cut from the first linked frame on, asked or not: what is asked changes no answer
            stop = min(stop, frames_asked[-1] + 1)
            frames = first + np.flatnonzero(linked[first:stop])
            for alike in self._arrangement.stretches(pairs, frames):
                if asked[alike].any():
                    out[alike] = body in self.collapse(on, int(alike[0]))
        return out

    def collapse(self, removed: int, frame: int) -> frozenset[int]:
        """Bodies that fall at that frame when ``removed`` is taken away."""
        if (removed, frame) in self._falls:
            return self._falls[removed, frame]
        contacts = self._arrangement.at(frame, self._cluster(removed))
        gone = self._parts(removed)
        while True:  # in rounds against what is gone by then, so that no order of bodies matters
            near = self._touching(gone, contacts) - gone
            fallen = {
                part
                for b in near
                if not self._stands(b, frame, contacts, gone)
                for part in self._parts(b)
            }
            if not fallen:
                break
            gone |= fallen
        self._falls[removed, frame] = frozenset(gone - {removed})
        return self._falls[removed, frame]

    def _stands(self, body: int, frame: int, contacts: Contacts, gone: set[int]) -> bool:
        # what the robot touches is a load of its own: it must not hold up what is beneath it
        handled = self._touching(self._robot, contacts)
        group = self._with_load(body, frame, gone | handled)
        mass = sum(self._mass[b] for b in group)
        if mass <= 0:
            return True
        normals, frictions, points = [], [], []
        for (i, j), rows in contacts.items():
            if ((i in group) == (j in group)) or i in gone or j in gone:
                continue
            point, normal, geom1, geom2 = self._episode.contacts.of_pair(
                (i, j), "position", "normal", "geom1", "geom2"
            )
            normals.append(normal[rows].astype(np.float64) * (1.0 if j in group else -1.0))
            frictions.append(np.maximum(self._friction[geom1[rows]], self._friction[geom2[rows]]))
            points.append(point[rows].astype(np.float64))
        if not normals:
            return False
        com = sum(self._mass[b] * self._arrangement.centre(b)[frame] for b in group) / mass
        arm = np.concatenate(points) - com
        return balanced(np.concatenate(normals), np.concatenate(frictions), arm)

    def _with_load(self, body: int, frame: int, without: set[int]) -> set[int]:
        """The body and all free bodies that it carries at that frame, directly or not."""
        group = self._parts(body)
        todo = list(group)
        while todo:
            below = todo.pop()
            for borne, bears in self._graph.load(below).items():
                if borne not in group and borne not in without and bears[frame]:
                    parts = self._parts(borne) - group
                    group |= parts
                    todo += parts
        return group & self._free

    def _cluster(self, body: int) -> list[Pair]:
        """Pairs with a free body that contacts among free bodies ever join to the given one."""
        if body not in self._clusters:
            self._clusters[body] = self._joined(body)
        return self._clusters[body]

    def _joined(self, body: int) -> list[Pair]:
        found, todo = {body}, [body]
        while todo:
            at = todo.pop()
            near = self._parts(at).union(self._sums.beside(at)) & self._free - found
            found |= near
            todo += near
        return sorted({(min(b, o), max(b, o)) for b in found for o in self._sums.beside(b)})

    def _touching(self, bodies: Iterable[int], contacts: Contacts) -> set[int]:
        some = set(bodies)
        near = {b for i, j in contacts for a, b in ((i, j), (j, i)) if a in some} & self._free
        return near.union(*(self._parts(b) for b in near))

    def _segments(self, body: int) -> NDArray[np.int64]:
        """First frames of the stretches with equal contact points of what hangs together with it."""
        if body not in self._cuts:
            self._cuts[body] = self._arrangement.segments(self._cluster(body))
        return self._cuts[body]

    def _linked(self, a: int, b: int) -> Bool:
        """(T,) true where a chain of contacts among free bodies joins the two."""
        frames = len(self._episode)
        reached = {a: np.ones(frames, np.bool_)}
        cluster = self._cluster(a)
        near = {body for pair in cluster for body in pair if body in self._free}
        touch = {
            pair: self._arrangement.touching(pair) for pair in cluster if near.issuperset(pair)
        }
        for part in near:
            for other in self._parts(part) - {part}:
                touch[part, other] = np.ones(frames, np.bool_)
        changed = True
        while changed:
            changed = False
            for (i, j), present in touch.items():
                for x, y in ((i, j), (j, i)):
                    if x in reached:
                        have = reached.get(y, np.zeros(frames, np.bool_))
                        gained = present & reached[x] & ~have
                        if gained.any():
                            reached[y] = have | gained
                            changed = True
        return reached.get(b, np.zeros(frames, np.bool_))
