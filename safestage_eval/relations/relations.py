"""All relations of one episode, and the signals that need relations or the support graph."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.episode.runs import runs
from safestage_eval.evidence.declare import RELATIONS, SIGNALS, Options, Signal
from safestage_eval.evidence.measure import Signals
from safestage_eval.evidence.partial import Partial
from safestage_eval.evidence.query import Growth
from safestage_eval.evidence.reference import Reference
from safestage_eval.evidence.series import Series, exact, hidden, hide, unknown

from . import between, unmeasured
from .exposure import Causes, Exposure
from .graph import SupportGraph
from .support_facts import Support

Bool = NDArray[np.bool_]


class RelationRequest(NamedTuple):
    """One relation to be decided.

    Attributes:
        relations: of the episode.
        bodies: names of bodies or unions, in the relation's order.
        graph: who supports whom.
        held: index of a body → (T,) it is held.
    """

    relations: Relations
    bodies: tuple[str, ...]
    graph: SupportGraph
    held: Callable[[int], Bool]

    @property
    def ids(self) -> list[int]:
        """The bodies' indices."""
        return [self.relations.episode.body_index[body] for body in self.bodies]


class SupportRequest(NamedTuple):
    """One signal with ``support`` to be measured.

    Attributes:
        relations: of the episode; ``relations.signals`` are the facts of other signals.
        signal: its declaration.
        bodies: names of bodies or unions, in the signal's order.
        since: what a change is measured from; None for the baseline.
        options: what the signal's definition adds.
        at: (N,) the frames at which a ``costly`` signal is measured; all frames of any other.
    """

    relations: Relations
    signal: Signal
    bodies: tuple[str, ...]
    since: Reference | None
    options: Options
    at: NDArray[np.int64]

    @property
    def episode(self) -> Episode:
        """The episode."""
        return self.relations.episode

    def number(self, name: str) -> float:
        """The value of an option that is a number, or its default, in SI."""
        value = dict(self.options).get(name)
        if not isinstance(value, float | int):
            value = next(option.default for option in self.signal.options if option.name == name)
        assert value is not None  # the option has a default
        return float(value)

    def exact(self, values: NDArray[np.float64]) -> Series:
        """A series that is known at every frame."""
        return exact(values, self.signal.dimension)

    def unknown(self, why: str) -> Series:
        """A series that is unknown at every frame, and why."""
        return unknown(len(self.at), self.signal.dimension, why)


class Relations(Support):
    """Relations of an episode by name and bodies: (T,) true or false, or unknown throughout."""

    def __init__(self, signals: Signals) -> None:
        """Share the signals' store, contact sums and shapes."""
        super().__init__(signals)
        signals.untouched = self._untouched

    def caught(self, body: str, on: str, wanted: Bool | None) -> Bool:
        """(T,) it is open whether something would catch ``body`` when ``on`` is taken away."""
        falls = self._falls_without(body, on, wanted)
        return falls.done & (falls.lower < falls.upper)

    def answered(self, body: str, on: str) -> Bool:
        """(T,) where it was computed already whether ``body`` falls when ``on`` is taken away."""
        everywhere = np.ones(len(self.episode), np.bool_)
        return everywhere if self.blind else self._falls_without(body, on, ~everywhere).done

    def _falls_without(self, body: str, on: str, wanted: Bool | None) -> Partial:
        """Whether ``body`` falls when ``on`` is taken away: 1 or 0, or from 0 to 1 where it is open."""

        def measure(near: Any, at: NDArray[np.int64]) -> tuple[NDArray[np.int64], Series]:
            relations: Relations = self if near is None else near
            index, frames = relations.episode.body_index, np.zeros(len(relations.episode), np.bool_)
            frames[at] = True
            falls, open_ = relations.dependence.depends_on(index[body], index[on], frames)
            done = relations.dependence.answered(index[body], index[on]).nonzero()[0]
            ends = falls[done].astype(np.float64), (falls | open_)[done].astype(np.float64)
            return done, Series(*ends, "number")

        query = self.signals.query("relation", "depends_on", (body, on))
        frames = np.ones(len(self.episode), np.bool_) if wanted is None else wanted
        return self.store.partial(query, frames, measure)

    @cached_property
    def exposure(self) -> Exposure:
        """Who has touched whom, directly or not."""
        return Exposure(self.episode, self.touches.beside, self.touches.touching)

    @cached_property
    def open_exposure(self) -> Exposure:
        """Who may have touched whom: all of which the force is not known touched."""
        return Exposure(self.episode, self.touches.beside, self.may_touch)

    @cached_property
    def causes(self) -> Causes:
        """Since when the robot has had to do with whom."""
        return Causes(self)

    @property
    def chained(self) -> bool:
        """Answers so far hang on contacts between any bodies: that some did not touch is one of them.

        Who was exposed to whom, and who moved though the robot had nothing to do with it.
        """
        if self.blind:
            return False
        computed = vars(self)
        return "exposure" in computed or ("causes" in computed and self.causes.unexplained())

    def _untouched(self, name: str) -> int:
        """Up to which frame the robot has certainly had nothing to do with a body."""
        if self.lacking("caused"):
            return len(self.episode)
        return self.causes.perhaps_since(self.episode.body_index[name])

    def get(self, name: str, bodies: Sequence[str], wanted: Bool | None = None) -> Bool | None:
        """(T,) truth of one relation; None where the trace lacks what it needs.

        Of a costly one only the ``wanted`` frames (T,) mean anything; all of them if None.
        Raises KeyError for a name or body that does not exist.
        """
        if self.lacking(name, bodies):
            return None
        if name == "depends_on" and not self.blind:
            return np.equal(self._falls_without(bodies[0], bodies[1], wanted).lower, 1)

        def measure(near: Any) -> Bool | None:
            relations: Relations = self if near is None else near
            return relations.decide(name, list(bodies))

        per_frame = RELATIONS[name].per_frame and not self.blind
        growth = Growth.PER_FRAME if per_frame else Growth.WHOLE
        query = self.signals.query("relation", name, tuple(bodies))
        return self.store.column(query, measure, growth)

    def lacking(self, name: str, bodies: Sequence[str] = ()) -> str:
        """The facts that the trace lacks to decide a relation; empty if none."""
        relation = RELATIONS[name]
        if relation.lacking is not None:
            return relation.lacking(self, tuple(bodies))
        return self.lacks_forces(tuple(bodies)) if "touch" in relation.needs else ""

    def doubtful(
        self, name: str, bodies: Sequence[str], wanted: Bool | None = None
    ) -> tuple[Bool, str] | None:
        """(T,) true where the trace does not tell a relation, whatever ``get`` says; and why.

        None where there is no doubt at any frame. ``wanted``: as in ``get``.
        """
        may_differ = RELATIONS[name].doubt
        doubt = None if may_differ is None else may_differ(self, tuple(bodies), wanted)
        lost = self.unmeasured(name, tuple(bodies))
        if lost is None:
            return doubt
        why = f"{name}({', '.join(bodies)}) was not measured at every frame"
        return (lost, why) if doubt is None else (lost | doubt[0], f"{why}; {doubt[1]}")

    def unmeasured(self, name: str, bodies: tuple[str, ...]) -> Bool | None:
        """(T,) true where something that a relation rests on was not measured; None if nowhere.

        Of forces, what was read so far counts: ``get`` comes first.
        """
        query = self.signals.query("unmeasured", name, bodies)
        return self.store.unmeasured(query, lambda _: self._unmeasured(name, bodies))

    def _unmeasured(self, name: str, bodies: tuple[str, ...]) -> Bool | None:
        lost = unmeasured.lost_by(
            self,
            name,
            bodies,
            lambda: self.get(name, bodies),
            lambda: self._if_touched(name, bodies),
        )
        if (
            RELATIONS[name].rests_on == "bodies" or RELATIONS[name].gate
        ) or not self.bearers_unseen:
            return lost
        truth = self.get(name, bodies)
        if truth is None or truth.all():
            return lost
        return unmeasured.either(lost, ~truth)

    def _if_touched(self, name: str, bodies: tuple[str, ...]) -> Bool:
        """(T,) truth of ``caused`` or ``exposed_to`` if all of which the force is not known touched."""
        first, *second = (
            [self.episode.body_index[b] for b in self.signals.bodies(name)] for name in bodies
        )
        if name == "caused":
            since = min(self.causes.open_since(body) for body in first)
            return np.asarray(np.arange(len(self.episode)) >= since)
        return self.open_exposure.exposed(first, second[0])

    def caveat(self, name: str) -> tuple[str, ...]:
        """How a relation is decided where it needs forces and there are none: a note, or nothing."""
        if not self.blind or "touch" not in RELATIONS[name].needs:
            return ()
        describe = RELATIONS[name].without_forces
        how = describe(self) if describe is not None else self.by_geometry
        return (f"without contact forces {name}() is decided {how}",)

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

        The costly ones are measured at the ``wanted`` frames (T,) only, and are unknown at the
        others; every frame is measured at most once. ``limits``: as in ``Signals.get``.
        """
        signal, bodies, query = SIGNALS[name], tuple(bodies), self.signals.query
        if signal.refine is not None:
            refine = signal.refine

            def refined(_: Any) -> Series:
                return refine(self, bodies, self.signals.get(name, bodies, options=options))

            asked = query("signal", f"{name}, refined", bodies, options=options)
            return self.store.series(asked, refined)
        if not signal.support:
            return self.signals.get(name, bodies, reference, reach, options, limits)
        if signal.costly:
            series = self._sparse(name, bodies, wanted, options)
        else:

            def everywhere(_: Any) -> Series:
                frames = np.arange(len(self.episode))
                request = SupportRequest(self, signal, bodies, reference, options, frames)
                return signal.measure(request)

            since = reference.key if reference else ""
            asked = query("signal", name, bodies, since, options=options)
            series = self.store.series(asked, everywhere)
        return self._known_part(name, bodies, series)

    def _sparse(
        self, name: str, bodies: tuple[str, ...], wanted: Bool | None, options: Options
    ) -> Series:
        """A costly signal at least at the wanted frames (T,)."""

        def measure(near: Any, at: NDArray[np.int64]) -> tuple[NDArray[np.int64], Series]:
            relations: Relations = self if near is None else near
            return at, relations.measure(name, at, bodies, options)

        frames = np.ones(len(self.episode), np.bool_) if wanted is None else wanted
        query = self.signals.query("signal", name, bodies, options=options)
        growth = Growth.WHOLE if self.blind else Growth.PER_FRAME
        partial = self.store.partial(query, frames, measure, growth)
        if self.store.lasting and len(bodies) < len(SIGNALS[name].args):
            self.bearers(bodies[0], 0)  # what a sentence will name is kept with the numbers
        return partial.series(frames, SIGNALS[name].dimension)

    def bearers(self, body: str, frame: int) -> tuple[str, ...]:
        """Names of the bodies that bear one directly at a frame."""

        def measure(_: Any) -> dict[str, list[list[int]]]:
            known = self.graph.bearers(self.episode.body_index[body])
            names = [b.name for b in self.episode.header.bodies]
            return {names[b]: runs(on).tolist() for b, on in sorted(known.items())}

        stored = self.store.value(self.signals.query("relation", "bearers", (body,)), measure)
        return tuple(
            name for name, spans in stored.items() if any(a <= frame < b for a, b in spans)
        )

    def _known_part(self, name: str, bodies: Sequence[str], series: Series) -> Series:
        """Make a signal unknown where something that it may rest on was not measured."""
        lost = self.signal_unmeasured(name, tuple(bodies))
        if name == "edge_margin" and len(bodies) == 1 and self.bearers_unseen:
            nothing = np.isneginf(series.upper)  # nothing that is seen bears it
            lost = unmeasured.either(lost, nothing)
        if lost is None:
            return series
        return hidden(series, lost, f"{name}({', '.join(bodies)}) was not measured at every frame")

    def signal_unmeasured(self, name: str, bodies: tuple[str, ...]) -> Bool | None:
        """(T,) where something that a signal of the support graph rests on was not measured.

        None if nowhere. Of poses and forces, what was read so far counts.
        """
        query = self.signals.query("unmeasured", name, bodies)
        return self.store.unmeasured(query, lambda _: self._signal_unmeasured(name, bodies))

    def _signal_unmeasured(self, name: str, bodies: tuple[str, ...]) -> Bool | None:
        gaps = self.signals.gaps
        lost = gaps.of_bodies(b for body in bodies for b in self.signals.bodies(body))
        alone = (
            name == "edge_margin" and len(bodies) == 1 and not self.blind
        )  # it sees to poses itself
        sees = name in ("overlap_xy", "fall", "moved_by", "tipped_by")  # to forces itself
        elsewhere = None if sees else unmeasured.lost_near(self, bodies)
        return unmeasured.either(lost, None if alone else unmeasured.lost_poses(self), elsewhere)

    def measure(
        self, name: str, at: NDArray[np.int64], bodies: Sequence[str], options: Options = ()
    ) -> Series:
        """(N,) a costly signal at N frames."""
        request = SupportRequest(self, SIGNALS[name], tuple(bodies), None, options, at)
        series, unseen = request.signal.measure(request), self.episode.unseen
        return series if unseen is None else hide(series, unseen[at])

    def between_frames(self, name: str, bodies: Sequence[str], frame: int) -> float | None:
        """M by which a distance may differ between two frames; see ``Signals.between_frames``."""
        return self.signals.between_frames(name, bodies, frame)

    def may_touch_between(self, a: str, b: str, where: Bool) -> Bool:
        """(T,) where two may have touched after a sample of ``where`` and before the next one."""
        return between.may_touch_between(self, a, b, where)

    def decide(
        self,
        name: str,
        bodies: list[str],
        graph: SupportGraph | None = None,
        held: Callable[[int], Bool] | None = None,
    ) -> Bool | None:
        """(T,) by the given support graph and grip; by ``self.graph`` and ``self.held`` if None."""
        request = RelationRequest(self, tuple(bodies), graph or self.graph, held or self.held)
        truth: Bool | None = RELATIONS[name].decide(request)
        return truth

    def may_bear(self, bearer: str, borne: str, graph: SupportGraph) -> Bool:
        """(T,) false only where the first body does not bear the second."""
        if self.lacking("supports", (bearer, borne)):
            return np.ones(len(self.episode), np.bool_)
        index = self.episode.body_index
        return graph.supports(index[bearer], index[borne])
