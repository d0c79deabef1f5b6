"""Dependence by statics: would this body fall if that one were taken away?"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.episode.contacts import Pair
from safestage_eval.evidence.contact_sums import ContactSums
from safestage_eval.evidence.missing_values import Gaps

from .arrangement import Cluster, Recording
from .graph import SupportGraph
from .near import Neighbours, Patch
from .statics import fallen

Bool = NDArray[np.bool_]
Contacts = list[tuple[Pair, Patch]]


@dataclass
class Answer:
    """The answer so far to whether one body depends on another.

    Attributes:
        falls: (T,) it does.
        open: (T,) it may.
        done: (T,) where it is known whether.
    """

    falls: Bool
    open: Bool
    done: Bool


class Dependence:
    """The collapse set of removing a body.

    Take a body away. Those fall that no forces within the friction cones of the remaining contacts
    can balance: one problem over all bodies that contacts join (``statics.fallen``), found once
    for each stretch of frames over which they lie alike (``arrangement``).

    Contacts that exchange a force count. What falls with them alone is asked again with all points
    that are within ``NEAR`` and carry nothing yet: what falls even then depends, what stands then is
    open.

    Any body can be taken away but the robot: with a drawer goes what is jointed to it. The robot's
    contacts hold what they touch. The parts of an object that are jointed together (a jar and its
    lid) stand and fall together. Bodies are indices into ``header.bodies``.
    """

    def __init__(
        self, episode: Episode, sums: ContactSums, graph: SupportGraph, gaps: Gaps
    ) -> None:
        """Nothing is computed before it is asked for."""
        self._episode, self._sums, self._gaps = episode, sums, gaps
        self._assemblies = graph.assemblies
        self._recording = Recording(episode, graph.assemblies)
        self._neighbours = Neighbours(episode, graph.assemblies.robot)
        self._clusters: dict[int, Cluster] = {}
        self._measured: dict[int, Bool] = {}
        self._answers: dict[tuple[int, int], Answer] = {}
        self._found: dict[tuple[int, int, int], tuple[set[int], set[int]]] = {}

    def beside(self, body: int) -> set[str]:
        """Names of the free bodies that contacts among free bodies ever join to the given one."""
        near = {body, *(b for pair in self._cluster(body).pairs for b in pair)}
        return {self._episode.header.bodies[b].name for b in near & self._assemblies.free}

    def answered(self, body: int, on: int) -> Bool:
        """(T,) where it was computed already whether ``body`` falls when ``on`` is removed."""
        return self._answer(body, on).done

    def depends_on(self, body: int, on: int, wanted: Bool | None = None) -> tuple[Bool, Bool]:
        """(T,) true where ``body`` falls when ``on`` is removed; and (T,) where that is open.

        Only the ``wanted`` frames (T,) of the answer mean anything; all of them if None.
        """
        answer = self._answer(body, on)
        missing = ~answer.done if wanted is None else wanted & ~answer.done
        if missing.any():
            first = self._cluster(body).stretch(body)
            for begin in np.unique(first[missing]).tolist():
                alike = np.flatnonzero((first == begin) & ~answer.done)
                falls, caught = self._collapse(body, on, begin)
                answer.falls[alike] = body in falls
                answer.open[alike] = body in caught
                answer.done[alike] = True
        return answer.falls, answer.open

    def _answer(self, body: int, on: int) -> Answer:
        if (body, on) not in self._answers:
            falls, open_ = np.zeros((2, len(self._episode)), np.bool_)
            done = np.ones(len(falls), np.bool_)
            if body in self._assemblies.free and on not in self._assemblies.robot and body != on:
                removed = self._removed(on)
                if body in removed:
                    falls[:] = True
                else:
                    done = ~self._cluster(body).linked(body, removed)
            self._answers[body, on] = Answer(falls, open_, done)
        return self._answers[body, on]

    def _removed(self, body: int) -> set[int]:
        """What goes when a body is taken away."""
        assemblies = self._assemblies
        return assemblies.of(body) if body in assemblies.free else assemblies.hanging(body)

    def _cluster(self, body: int) -> Cluster:
        if body not in self._clusters:
            members, todo = {body}, [body]
            while todo:
                at = todo.pop()
                near = self._assemblies.of(at).union(self._sums.beside(at)) & self._assemblies.free
                todo += near - members
                members |= near
            members &= self._assemblies.free
            beside = {b: self._sums.beside(b) for b in members | {body}}
            pairs = sorted({(min(b, o), max(b, o)) for b, others in beside.items() for o in others})
            cluster = Cluster(self._recording, members, pairs)
            self._clusters.update(dict.fromkeys(members | {body}, cluster))
        return self._clusters[body]

    def _usual(self, body: int, begin: int) -> int:
        """The frame that stands for a stretch; one at which all contacts are known if there is one."""
        cluster = self._cluster(body)
        if body not in self._measured:
            self._sums.look(set(cluster.pairs))
            lost = self._gaps.of_pairs(cluster.pairs)
            never = np.zeros(len(self._episode), np.bool_)
            self._measured[body] = ~(never if lost is None else lost)
        frames = np.flatnonzero(cluster.stretch(body) == begin)
        known = frames[self._measured[body][frames]]
        return cluster.usual(known if len(known) else frames)

    def _collapse(self, body: int, on: int, begin: int) -> tuple[set[int], set[int]]:
        """What falls when one is taken away, of all that hang together with a body over a stretch.

        And what falls, but for points that are near and carry nothing yet.
        """
        cluster = self._cluster(body)
        joined = cluster.joined(body)[:, begin]
        bodies = [b for b, with_it in zip(cluster.free, joined, strict=True) if with_it]
        key = (bodies[0], on, begin)
        if key not in self._found:
            frame = self._usual(body, begin)
            falls = self._falls(bodies, on, self._contacts([cluster], frame), frame)
            caught = self._caught(falls, on, frame) if falls else set()
            self._found[key] = falls - caught, caught
        return self._found[key]

    def _contacts(self, clusters: Iterable[Cluster], frame: int) -> Contacts:
        """All contact points of clusters at a frame that carry something."""
        pairs = dict.fromkeys(pair for cluster in clusters for pair in cluster.pairs)
        return [(pair, self._recording.points(pair, frame)) for pair in pairs]

    def _falls(self, bodies: Iterable[int], on: int, contacts: Contacts, frame: int) -> set[int]:
        """Which of some bodies fall when one is taken away."""
        free, removed, of = self._assemblies.free, self._removed(on), self._assemblies.of
        heads = sorted({min(of(b) & free) for b in bodies})
        members = set().union(*map(of, heads))
        contacts = [
            (pair, points)
            for pair, points in contacts
            if len(points.friction) and not members.isdisjoint(pair) and pair[0] not in of(pair[1])
        ]
        pile = self._recording.pile(heads, contacts, frame)
        off = [not removed.isdisjoint(pair) for pair, points in contacts for _ in points.friction]
        gone = np.array([head in removed for head in heads])
        falls = fallen(pile, gone, np.array(off, np.bool_)) & ~gone
        return set().union(*(of(head) for head, down in zip(heads, falls, strict=True) if down))

    def _caught(self, falls: set[int], on: int, frame: int) -> set[int]:
        """What of all that falls is held where points bear that are near and carry nothing yet."""
        at, loose = np.array([frame]), sorted(falls)
        beside = self._neighbours.about(np.array(loose), at)[0]
        gone, of = falls | self._removed(on), self._assemblies.of
        if not (beside & ~np.isin(np.arange(beside.shape[1]), sorted(gone))).any():
            return set()
        near = {(min(i, j), max(i, j)) for i, row in zip(loose, beside, strict=True)
                for j in np.flatnonzero(row).tolist()}  # fmt: skip
        contacts = []
        for i, j in sorted(near):
            if self._removed(on).isdisjoint((i, j)) and i not in of(j):
                points = self._neighbours.patches(i, j, at)[0]
                # nothing presses there yet, so friction cannot wedge anything
                contacts.append(((i, j), points._replace(friction=0 * points.friction)))
        bodies = {b for pair, points in contacts if len(points.friction) for b in pair} | falls
        clusters = {id(c): c for c in map(self._cluster, sorted(bodies & self._assemblies.free))}
        contacts += self._contacts(clusters.values(), frame)
        bodies = {b for cluster in clusters.values() for b in cluster.free}
        return falls - self._falls(bodies, on, contacts, frame)
