"""Signals that rules compute from others: as intervals, from all that their operands may be."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from safestage_eval.evidence.interval_arithmetic import (
    Ends,
    change_per_second,
    change_within,
    combined,
    summed_over_time,
)
from safestage_eval.evidence.series import Series, exact
from safestage_eval.evidence.spectral_arc import AT_REST, sparc
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.operations import OPERATIONS
from safestage_eval.states.band import Band, Bool

from .answers import Answers
from .costly import Costly
from .values import Asked, Env, ends_early

FAR = 1e3
"""M, up to where a distance is measured exactly that something is computed from."""


class ComputedSignals(Answers, ABC):
    """Answers, and signals that are computed from others.

    Attributes:
        costly: which parts of the rules are.
        frames: T.
    """

    costly: Costly
    frames: int

    @abstractmethod
    def measured_series(
        self, measurement: Asked, atom: ast.SignalAtom, env: Env, wanted: Bool | None
    ) -> Series:
        """(T,) the signal of an atom, of a measurement that is known already."""

    @abstractmethod
    def state(self, call: ast.Call, env: Env, wanted: Bool | None = None) -> Band:
        """A declared state or a built-in relation."""

    @abstractmethod
    def exempt(self, measurement: Asked) -> bool:
        """The body has no such quantity."""

    def computed_series(
        self, computed: ast.DerivedDef, bodies: tuple[str, ...], wanted: Bool | None
    ) -> Series:
        """(T,) SI, of certain bodies; what is costly is measured at the ``wanted`` frames alone."""
        if wanted is not None and self.costly.computed(computed):
            series = self._computed(computed, bodies, wanted)
        else:
            key = ("computed", computed.name, bodies)
            series = self.once(computed, key, self._computed, computed, bodies, None)
        self.notes.update(dict.fromkeys(series.notes))
        return series

    def _computed(
        self, computed: ast.DerivedDef, bodies: tuple[str, ...], wanted: Bool | None
    ) -> Series:
        """−∞ for a body that lacks one of the quantities, like the quantity itself."""
        env, operation = dict(zip(computed.of, bodies, strict=True)), computed.operation
        where = wanted if OPERATIONS[operation].pointwise else None
        operands = [self._operand(one, env, where) for one in computed.operands]
        notes = tuple(dict.fromkeys(note for one in operands for note in one.notes))
        if self.lacks_operand(computed, bodies):
            return exact(np.full(self.frames, -np.inf), computed.dimension, notes)
        t = self.episode.t
        if operation == "derivative" and computed.over is not None:
            ends = self._change_over(operands[0], computed.over)
        elif operation == "derivative":
            ends = change_per_second(operands[0], t)
        elif operation == "sparc":
            ends = self._smoothness(operands[0], wanted)
            if np.abs(operands[0].upper).max(initial=0.0) < AT_REST:
                notes += (f"{computed.name}() of what has not moved is not known",)
        elif operation == "holds":
            ends = operands[0].lower, operands[0].upper
        elif operation == "integral":
            ends = summed_over_time(operands[0], t)
            lost = ~np.isfinite(ends[0]) | ~np.isfinite(ends[1])
            if lost.any():
                since = float(t[int(lost.argmax())])
                notes += (f"what {computed.name}() adds up is not known from {since:.2f} s on",)
        else:
            ends = combined(operation, operands)
        return Series(*ends, computed.dimension, notes)

    def _change_over(self, of: Series, over: ast.Duration | ast.Parameter) -> Ends:
        """Within that time around each sample; of a rollout that is still running, before it.

        Where the trace stops before its rollout did, what lies half that time before its end is open.
        """
        given = self.duration(over)
        seconds = given.amount * (self.episode.dt if given.frames else 1.0)
        t = self.episode.t
        if self.causal:
            return change_within(of, t, seconds, 0.0)
        lower, upper = change_within(of, t, seconds / 2, seconds / 2)
        if not ends_early(self.episode):
            return lower, upper
        open_ = t + seconds / 2 > t[-1] * (1 + 1e-9)
        return np.where(open_, -np.inf, lower), np.where(open_, np.inf, upper)

    def _smoothness(self, of: Series, wanted: Bool | None) -> Ends:
        """SPARC of all that came before, at the wanted frames; not known behind what is not known."""
        t, speed = self.episode.t, np.abs(of.upper)
        known = np.logical_and.accumulate(np.isfinite(speed) & (of.lower == of.upper))
        asked = known if wanted is None else known & wanted
        even = t[0] + self.episode.dt * np.arange(len(t)) if not self.clock.uniform else t
        lower, upper = np.full(self.frames, -np.inf), np.zeros(self.frames)
        for frame in np.flatnonzero(asked):
            some = speed[: frame + 1]
            if even is not t:
                some = np.interp(even[even <= t[frame] + 1e-9], t[: frame + 1], some)
            lengths = sparc(some, self.episode.dt)
            if lengths is not None:
                lower[frame] = upper[frame] = lengths
        return lower, upper

    def _operand(self, operand: ast.Operand, env: Env, wanted: Bool | None) -> Series:
        if isinstance(operand, ast.StateAtom):
            band = self.state(operand.call, env, wanted)
            sure = band.true.astype(np.float64)
            if not band.unknown.any():
                return Series(sure, sure, "ratio")
            return Series(sure, (~band.false).astype(np.float64), "ratio")
        if isinstance(operand, ast.SignalAtom):
            return self.measured_series(self._of_operand(operand, env), operand, env, wanted)
        return exact(np.full(self.frames, self.number(operand, env)), "")

    def _of_operand(self, operand: ast.SignalAtom, env: Env) -> Asked:
        """The measurement behind an operand: a distance exactly, however far."""
        name, bodies, options = self.measured(operand.call, env)
        far = FAR if self.signal(name).capped else 0.0
        return Asked(name, bodies, options, (0.0,), far)

    def _measurements(self, computed: ast.DerivedDef, bodies: tuple[str, ...]) -> list[Asked]:
        env = dict(zip(computed.of, bodies, strict=True))
        signals = [one for one in computed.operands if isinstance(one, ast.SignalAtom)]
        return [self._of_operand(one, env) for one in signals]

    def lacks_operand(self, computed: ast.DerivedDef, bodies: tuple[str, ...]) -> bool:
        """The bodies have no such quantity as one that it is computed from."""
        return any(map(self.exempt, self._measurements(computed, bodies)))

    def between_frames(self, name: str, bodies: tuple[str, ...], frame: int) -> float | None:
        """How much further (SI) a signal may have gone between a frame and its neighbours.

        For distances, and what is computed from them frame by frame; None for other signals. A
        derivative is the mean over the time between two samples, and an integral a sum.
        """
        computed = self.rules.derived.get(name)
        if computed is None:
            return self.relations.between_frames(name, bodies, frame)
        if not OPERATIONS[computed.operation].pointwise:
            return None
        asked = self._measurements(computed, bodies)
        each = [self.between_frames(one.name, one.bodies, frame) for one in asked]
        known = [one for one in each if one is not None]
        if not known or computed.operation != "product":
            return sum(known) if known else None
        if len(each) > 1:
            return np.inf
        numbers = [n for n in computed.operands if isinstance(n, ast.Quantity | ast.Parameter)]
        return known[0] * float(np.prod([abs(self.number(n, {})) for n in numbers]))
