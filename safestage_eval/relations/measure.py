"""All relations of one episode, and the signals that need the support graph."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from safestage_eval.geometry.cavity import inside_parts
from safestage_eval.geometry.edge import edge_margin
from safestage_eval.signals.measure import Signals
from safestage_eval.signals.reference import Reference
from safestage_eval.signals.series import Series, exact, unknown

from .dependence import Dependence
from .graph import SupportGraph
from .vocabulary import RELATIONS

Bool = NDArray[np.bool_]


class Relations:
    """Relations of an episode by name and bodies: (T,) true or false, or unknown throughout."""

    def __init__(self, signals: Signals) -> None:
        """Shares the signals' cache of contact sums and shapes."""
        self.signals = signals
        self.episode = signals.episode
        self._known: dict[tuple[str, tuple[str, ...]], Bool | None] = {}
        self._edge: dict[tuple[str, ...], Series] = {}

    @cached_property
    def graph(self) -> SupportGraph:
        """Who bears whom."""
        return SupportGraph(self.episode, self.signals.contact_sums)

    @cached_property
    def dependence(self) -> Dependence:
        """Who falls without whom."""
        return Dependence(self.episode, self.signals.contact_sums, self.graph)

    def get(self, name: str, bodies: Sequence[str]) -> Bool | None:
        """(T,) truth of one relation; None where the trace lacks what it needs.

        Raises KeyError for a name or body that does not exist.
        """
        key = (name, tuple(bodies))
        if key not in self._known:
            self._known[key] = self._decide(name, list(bodies))
        return self._known[key]

    def signal(
        self, name: str, bodies: Sequence[str], reference: Reference | None = None, reach: float = 0
    ) -> Series:
        """Any signal: those of ``signals``, and those that need the support graph."""
        if name != "edge_margin":
            return self.signals.get(name, bodies, reference, reach)
        key = tuple(bodies)
        if key not in self._edge:
            self._edge[key] = self._edge_margin(*bodies)
        return self._edge[key]

    def _decide(self, name: str, bodies: list[str]) -> Bool | None:
        spec, index = RELATIONS[name], self.episode.body_index
        if name == "inside":
            return self._inside(*bodies)
        if "forces" in spec.needs and self.episode.header.force_source == "none":
            return None
        ids = [index[body] for body in bodies]
        if name == "supports":
            return self.graph.supports(*ids)
        if name == "supported":
            return self.graph.supported[ids[0]]
        if name == "carried":
            return self._carried[ids[0]]
        if name == "depends_on":
            return self.dependence.depends_on(*ids)
        if name == "held":
            return self._held(ids[0])
        raise KeyError(name)

    @cached_property
    def _carried(self) -> dict[int, Bool]:
        return self.graph.carried(self._held)

    def _held(self, body: int) -> Bool:
        """(T,) touched by a left and by a right finger."""
        touched = []
        for side in ("left", "right"):
            fingers = [i for i, b in enumerate(self.episode.header.bodies) if b.finger == side]
            touch = np.zeros(len(self.episode), np.bool_)
            for finger in fingers:
                if finger != body:
                    touch |= self.signals.contact_sums.touching(body, finger)
            touched.append(touch)
        return touched[0] & touched[1]

    def _inside(self, a: str, container: str) -> Bool | None:
        """(T,) lowest point under the rim and within, and (centroid within, or borne by it).

        Without a declared cavity nothing is inside: false, not unknown.
        """
        episode, movers = self.episode, self.signals.movers
        cavity = episode.bodies[container].cavity
        if cavity is None:
            return np.zeros(len(episode), np.bool_)
        if not movers.of([a]):
            return None
        low, centroid = inside_parts(movers[a], movers[container], cavity)
        bears = self.get("supports", (container, a))
        inside = low & centroid if bears is None else low & (centroid | bears)
        return np.broadcast_to(inside, len(episode))

    def _edge_margin(self, a: str, s: str | None = None) -> Series:
        """(T,) m; of whatever bears the body if no second is named: −∞ where nothing does.

        Several bearers form one surface. Unknown where what bears the body has no upward face
        under it (a ball in a groove, a leaning board).
        """
        frames, movers = len(self.episode), self.signals.movers
        if not movers.of([a]):
            return unknown(frames, "length", f"the trace has no shape of {a}")
        if s is not None:
            margin = np.broadcast_to(edge_margin(movers[a], [movers[s]]), frames)
            return exact(np.where(np.isnan(margin), -np.inf, margin), "length")
        if self.episode.header.force_source == "none":
            return unknown(frames, "length", "the trace has no contact forces")
        names = [body.name for body in self.episode.header.bodies]
        bearers = self.graph.bearers(self.episode.body_index[a])
        lower, upper = np.full(frames, -np.inf), np.full(frames, -np.inf)
        bears = np.array(list(bearers.values())).reshape(len(bearers), frames)
        for combination in np.unique(bears, axis=1).T:
            if not combination.any():
                continue
            at = np.flatnonzero((bears == combination[:, None]).all(axis=0))
            under = [movers[names[b]] for b, on in zip(bearers, combination, strict=True) if on]
            margin = edge_margin(movers[a], under, at)[at]
            lower[at] = np.where(np.isnan(margin), -np.inf, margin)
            upper[at] = np.where(np.isnan(margin), np.inf, margin)
        return Series(lower, upper, "length")
