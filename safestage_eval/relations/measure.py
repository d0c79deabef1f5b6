"""All relations of one episode, and the signals that need the support graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from safestage_eval.geometry.cavity import inside_parts
from safestage_eval.geometry.edge import edge_margin
from safestage_eval.geometry.footprint import overlap_xy
from safestage_eval.signals.measure import Signals
from safestage_eval.signals.options import Options
from safestage_eval.signals.reference import Reference
from safestage_eval.signals.series import Series, exact, unknown
from safestage_eval.signals.vocabulary import SIGNALS

from .dependence import Dependence
from .graph import SupportGraph
from .slip import slip
from .vocabulary import RELATIONS

Bool = NDArray[np.bool_]


COSTLY = ("edge_margin", "overlap_xy", "depends_on")
"""What clips polygons or solves statics: found out only at the frames that matter."""


@dataclass(frozen=True, eq=False)
class Partial:
    """A signal measured at some frames only: bounds (T,) and which frames are done (T,)."""

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    done: Bool
    notes: dict[str, Bool]
    """Note → (T,) the frames that it is about."""

    @classmethod
    def blank(cls, frames: int) -> Partial:
        """Nothing measured yet."""
        return cls(
            np.full(frames, -np.inf), np.full(frames, np.inf), np.zeros(frames, np.bool_), {}
        )


class Relations:
    """Relations of an episode by name and bodies: (T,) true or false, or unknown throughout."""

    def __init__(self, signals: Signals) -> None:
        """Shares the signals' cache of contact sums and shapes."""
        self.signals = signals
        self.episode = signals.episode
        self._known: dict[tuple[str, tuple[str, ...]], Bool | None] = {}
        self._partial: dict[tuple[str, tuple[str, ...]], Partial] = {}

    @cached_property
    def graph(self) -> SupportGraph:
        """Who bears whom."""
        return SupportGraph(self.episode, self.signals.contact_sums)

    @cached_property
    def dependence(self) -> Dependence:
        """Who falls without whom."""
        return Dependence(self.episode, self.signals.contact_sums, self.graph)

    def get(self, name: str, bodies: Sequence[str], wanted: Bool | None = None) -> Bool | None:
        """(T,) truth of one relation; None where the trace lacks what it needs.

        Of a ``COSTLY`` one only the ``wanted`` frames (T,) mean anything; all of them if None.
        Raises KeyError for a name or body that does not exist.
        """
        if self.lacking(name):
            return None
        if name == "depends_on":
            ids = [self.episode.body_index[body] for body in bodies]
            return self.dependence.depends_on(ids[0], ids[1], wanted)
        key = (name, tuple(bodies))
        if key not in self._known:
            self._known[key] = self._decide(name, list(bodies))
        return self._known[key]

    def lacking(self, name: str) -> str:
        """What the trace would need to tell a relation, and does not have; empty if nothing."""
        header = self.episode.header
        if "forces" in RELATIONS[name].needs and header.force_source == "none":
            return "contact forces"
        fingers = {body.finger for body in header.bodies}
        gripper = any(body.kind == "gripper" for body in header.bodies)
        if name in ("held", "carried") and gripper and not {"left", "right"} <= fingers:
            return "names of the left and the right finger"
        if name == "depends_on" and self.dependence.massless:
            return f"mass of {', '.join(self.dependence.massless)}"
        return ""

    def signal(
        self,
        name: str,
        bodies: Sequence[str],
        reference: Reference | None = None,
        reach: float = 0,
        wanted: Bool | None = None,
        options: Options = (),
        limits: Sequence[float] = (),
    ) -> Series:
        """Any signal: those of ``signals``, and those that need the support graph.

        The ``COSTLY`` ones are measured at the ``wanted`` frames (T,) only, and are unknown at the
        others; every frame is measured at most once. ``limits``: as in ``Signals.get``.
        """
        if name == "slip":
            return slip(self.episode, bodies[0], self.get("held", bodies), reference)
        if name not in COSTLY:
            return self.signals.get(name, bodies, reference, reach, options, limits)
        key = (name, tuple(bodies))
        if key not in self._partial:
            self._partial[key] = Partial.blank(len(self.episode))
        partial = self._partial[key]
        todo = np.ones(len(self.episode), np.bool_) if wanted is None else wanted
        missing = np.flatnonzero(todo & ~partial.done)
        if len(missing):
            measure = self._edge_margin if name == "edge_margin" else self._overlap
            found = measure(missing, *bodies)
            partial.lower[missing], partial.upper[missing] = found.lower, found.upper
            partial.done[missing] = True
            for note in found.notes:
                vague = np.isneginf(found.lower) & np.isposinf(found.upper)
                about = partial.notes.setdefault(note, np.zeros(len(self.episode), np.bool_))
                about[missing[vague]] = True
        notes = tuple(note for note, about in partial.notes.items() if (about & todo).any())
        return Series(partial.lower, partial.upper, SIGNALS[name].dimension, notes)

    def _decide(self, name: str, bodies: list[str]) -> Bool | None:
        index = self.episode.body_index
        if name == "inside":
            return self._inside(*bodies)
        ids = [index[body] for body in bodies]
        if name == "supports":
            return self.graph.supports(*ids)
        if name == "supported":
            return self.graph.supported(ids[0])
        if name == "carried":
            return self.graph.carried(ids[0], self._held)
        if name == "held":
            return self._held(ids[0])
        raise KeyError(name)

    def _held(self, body: int) -> Bool:
        """(T,) touched by a left and by a right finger."""
        bodies, sums = self.episode.header.bodies, self.signals.contact_sums
        touched = {side: np.zeros(len(self.episode), np.bool_) for side in ("left", "right")}
        for other in sums.beside(body):
            finger = bodies[other].finger
            if finger is not None:
                touched[finger] |= sums.touching(body, other)
        return touched["left"] & touched["right"]

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

    def _overlap(self, at: NDArray[np.int64], a: str, b: str) -> Series:
        """(N,) share of a's footprint over b's at some frames."""
        movers = self.signals.movers
        for name in (a, b):
            if not movers.of([name]):
                return unknown(len(at), "ratio", f"the trace has no shape of {name}")
        share = np.broadcast_to(overlap_xy(movers[a], movers[b], at), len(self.episode))[at]
        return exact(np.where(np.isnan(share), 0.0, share), "ratio")

    def _edge_margin(self, at: NDArray[np.int64], a: str, s: str | None = None) -> Series:
        """(N,) m, at some frames; of whatever bears the body if no second is named.

        Several bearers form one surface. −∞ where nothing bears it; unknown where what bears it
        has no upward face under it (a ball in a groove, a leaning board).
        """
        frames, movers = len(self.episode), self.signals.movers
        if not movers.of([a]):
            return unknown(len(at), "length", f"the trace has no shape of {a}")
        if s is not None and not movers.of([s]):
            return unknown(len(at), "length", f"the trace has no shape of {s}")
        if s is not None:
            margin = np.broadcast_to(edge_margin(movers[a], [movers[s]], at), frames)[at]
            return exact(np.where(np.isnan(margin), -np.inf, margin), "length")
        if self.episode.header.force_source == "none":
            return unknown(len(at), "length", "the trace has no contact forces")
        names = [body.name for body in self.episode.header.bodies]
        bearers = self.graph.bearers(self.episode.body_index[a])
        lower, upper = np.full(frames, -np.inf), np.full(frames, -np.inf)
        bears = np.array(list(bearers.values())).reshape(len(bearers), frames)[:, at]
        for combination in np.unique(bears, axis=1).T:
            if not combination.any():
                continue
            there = at[(bears == combination[:, None]).all(axis=0)]
            under = [movers[names[b]] for b, on in zip(bearers, combination, strict=True) if on]
            margin = edge_margin(movers[a], under, there)[there]
            lower[there] = np.where(np.isnan(margin), -np.inf, margin)
            upper[there] = np.where(np.isnan(margin), np.inf, margin)
        bare = np.isneginf(lower) & np.isposinf(upper)
        notes = (f"what bears {a} has no upward face under it",) if bare[at].any() else ()
        return Series(lower[at], upper[at], "length", notes)
