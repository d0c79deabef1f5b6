"""Conditions of the rule language over one episode."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from safestage_eval.evidence.interval_arithmetic import change_since
from safestage_eval.evidence.reference import Reference, latest
from safestage_eval.evidence.series import Series
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import CLAUSES, ClauseKind
from safestage_eval.states import band, moment, past
from safestage_eval.states.band import Band, Bool
from safestage_eval.states.masks import widened
from safestage_eval.states.moment import Moment, Truth, truth_of

from . import event_order, hidden_start
from .answers import Found
from .computed_signals import ComputedSignals
from .costly import Costly
from .values import Asked, Env, lasting, limit_margin


class Conditions(ComputedSignals, ABC):
    """Conditions as ``Band`` of normalised margins; subclasses evaluate states."""

    def __init__(
        self,
        relations: Relations,
        rules: ast.RuleSet,
        params: ast.Params,
        *,
        causal: bool = False,
    ) -> None:
        """Arguments as in ``Evaluator``."""
        super().__init__(relations, rules, params)
        self.causal = causal
        self.frames = len(self.episode)
        self._obligation: ClauseKind | None = None
        self._signs = False
        """Only whether something holds matters, not by what margin."""
        self.costly = Costly(rules)
        self._cheap: dict[int, ast.Condition] = {}
        """Conditions that ask for nothing costly, by identity; each is kept, and so stays itself."""

    @abstractmethod
    def state(self, call: ast.Call, env: Env, wanted: Bool | None = None) -> Band:
        """A declared state or a built-in relation; ``wanted`` as in ``condition``."""

    @abstractmethod
    def must_not(
        self,
        call: ast.Call,
        env: Env,
        kind: ClauseKind | None = None,
        wanted: Bool | None = None,
    ) -> Band:
        """A state, as an obligation that breaks where it holds has to see it."""

    @abstractmethod
    def truth(self, event: ast.Event, env: Env) -> Truth:
        """The frames of an event; of a bare state, all frames where it holds."""

    @property
    @abstractmethod
    def success_at_sample(self) -> bool:
        """Success came when a sample was taken, not between two."""

    @abstractmethod
    def moments(self, event: ast.Event, env: Env) -> list[Moment]:
        """When an event happens; a bare state happens where it starts."""

    def obliged(self, kind: ClauseKind | None, find: Callable[..., Found], *args: Any) -> Found:
        """Call ``find`` with conditions read as those of an obligation of this kind.

        A limit on a tilt that a body does not have is skipped there: it holds where it must, and
        does not where it must not. A state (None) asks whether the body is tilted, and it never is.
        """
        outer, self._obligation = self._obligation, kind
        try:
            return find(*args)
        finally:
            self._obligation = outer

    def _forbidding(self) -> bool:
        """Conditions are those of an obligation that breaks where they hold."""
        return self._obligation is not None and not CLAUSES[self._obligation].wanted

    def only_signs(self, find: Callable[..., Found], *args: Any) -> Found:
        """Call ``find`` where only the signs of margins matter, not their sizes."""
        outer, self._signs = self._signs, True
        try:
            return find(*args)
        finally:
            self._signs = outer

    @property
    def signs_alone(self) -> bool:
        """Only the signs of margins matter now."""
        return self._signs

    def asks_costly(self, what: ast.Atom | ast.Alternative) -> bool:
        """Where it is asked for makes a difference: something in it is costly."""
        return self.costly.asked(what)

    def series(self, atom: ast.SignalAtom, env: Env, wanted: Bool | None = None) -> Series:
        """The signal of an atom, up to where its limits need it exactly, at the wanted frames."""
        return self.measured_series(self.asked(atom, env), atom, env, wanted)

    def measured_series(
        self, measurement: Asked, atom: ast.SignalAtom, env: Env, wanted: Bool | None
    ) -> Series:
        """Like ``series``, of a given measurement."""
        computed = self.rules.derived.get(measurement.name)
        if computed is not None and atom.since is None:
            return self.computed_series(computed, measurement.bodies, wanted)
        reference = when = None
        if atom.since is not None:
            reference, when = self.since(atom.since, env)

        def measured(reference: Reference | None) -> Series:
            name, bodies, options, limits, reach = measurement
            if computed is not None:
                series = self.computed_series(computed, bodies, None)
                if reference is None or reference.since is None:
                    return series
                return Series(
                    *change_since(series, reference.since), series.dimension, series.notes
                )
            return self.relations.signal(name, bodies, reference, reach, wanted, options, limits)

        hidden = when is not None and atom.since is not None and hidden_start.concerns(atom.since)
        if when is not None and hidden and self.signal(measurement.name).metric:
            baseline = self.relations.signals.baseline
            series = hidden_start.since_some(measured, baseline, when.possible, measurement.reach)
            when = None
        else:
            series = measured(reference)
            if reference is not None and atom.since is not None:
                earlier = self.earliest(atom.since, reference)
                if earlier is not None:
                    series = hidden_start.either(series, measured(earlier))
        for note in series.notes:
            self.notes[note] = None
        if when is None:
            return series
        newest = np.maximum.accumulate(np.where(when.possible, np.arange(self.frames), -1))
        open_ = (newest >= 0) & ~when.sure[newest]
        lower, upper = np.where(open_, -np.inf, series.lower), np.where(open_, np.inf, series.upper)
        return replace(series, lower=lower, upper=upper)

    def since(self, event: ast.Event, env: Env) -> tuple[Reference, Truth | None]:
        """The reference of a change since an event; and the event's frames, if any is uncertain."""
        return self.once(event, ("since", id(event), *env.items()), self._since, event, env)

    def _since(self, event: ast.Event, env: Env) -> tuple[Reference, Truth | None]:
        when = moment.frames_of(self.moments(event, env), self.frames)
        baseline, instants = self.relations.signals.baseline, when.possible.nonzero()[0]
        if hidden_start.concerns(event):
            first = int(instants[0]) if len(instants) else self.frames
            reference = hidden_start.before(baseline, first, self.frames)
        else:
            since, key = latest(instants, self.frames), f"since {instants.tobytes().hex()}"
            reference = Reference(baseline, since, key)
        return reference, None if when.known else when

    def earliest(self, event: ast.Event, reference: Reference) -> Reference | None:
        """The reference at the samples before those that show an event; None where it came with them."""
        if event.kind == "start" or hidden_start.concerns(event):
            return None
        if event.kind == "success" and self.success_at_sample:
            return None
        return hidden_start.one_earlier(reference, self.clock.coarse)

    def condition(self, condition: ast.Condition, env: Env, wanted: Bool | None = None) -> Band:
        """All atoms hold.

        Only the ``wanted`` frames (T,) of the result mean anything; all of them if None. Costly
        signals come last, and are measured only where no other atom has already decided.
        """
        plain, gates = self.costly.split(condition)
        if gates:
            return self._gated(self.condition(plain, env, wanted), gates, env, wanted)
        if id(condition) not in self._cheap and not self.costly.asked(condition):
            self._cheap[id(condition)] = condition
        if id(condition) in self._cheap and len(condition.atoms) == 1:
            return self.atom(condition.atoms[0], env)
        if event_order.depends_on_order(condition, self.clock.coarse):
            bands = [self.atom(atom, env) for atom in condition.atoms]
            bands = event_order.in_any_order(condition, bands, self.clock.coarse)
            return band.both(bands, self.frames)
        if id(condition) in self._cheap:
            return band.both([self.atom(atom, env) for atom in condition.atoms], self.frames)
        mask = np.ones(self.frames, np.bool_) if wanted is None else wanted
        bands = []
        decided = 0  # how many of them the mask knows of
        for atom in self.costly.sorted(condition.atoms):
            if self.costly.asked(atom):
                for other in bands[decided:]:
                    mask = mask & (~other.false if self._signs else other.upper != -np.inf)
                decided = len(bands)
            bands.append(self.atom(atom, env, mask))
        return band.both(bands, self.frames)

    def _gated(
        self, rest: Band, gates: Sequence[ast.StateAtom], env: Env, wanted: Bool | None
    ) -> Band:
        """A condition with its gates, which are evaluated only where the rest may hold.

        Where it does not hold anyway, its margin stays: a gate does not say how close it came.
        """
        may = rest.upper >= 0
        if not (may if wanted is None else may & wanted).any():
            return rest
        gate_bands = [self.atom(gate, env) for gate in gates]
        for gate, open_ in zip(gates, gate_bands, strict=True):
            held_back = (rest.lower >= 0) & open_.false
            if (
                gate.call is not None
                and (held_back if wanted is None else held_back & wanted).any()
            ):
                bodies = ", ".join(env.get(arg, arg) for arg in gate.call.args)
                self.notes[f"not counted where {gate.call.name}({bodies}) is false"] = None
        shut = band.both([rest, *gate_bands], self.frames)
        lower = np.where(may, shut.lower, rest.lower)
        if rest.exact and shut.exact:
            return Band(lower, lower)
        return Band(lower, np.where(may, shut.upper, rest.upper))

    def alternative(
        self, alternative: ast.Alternative, env: Env, wanted: Bool | None = None
    ) -> Band:
        """A condition, or the frames of an event; ``wanted`` as in ``condition``."""
        if type(alternative) is ast.Condition:
            return self.condition(alternative, env, wanted)
        assert type(alternative) is ast.Event
        call, edge = alternative.call, alternative.edge
        if call is not None and edge is None:
            return self.must_not(call, env, "forbid", wanted)
        if call is not None and edge == "start" and self._forbidding():
            now = truth_of(self.must_not(call, env, "forbid"))
            truth = moment.edges(now, "start")
        elif call is not None and edge is not None and wanted is not None and self._deep(call):
            truth = moment.edges(self._signs_at(call, env, widened(wanted, 1)), edge)
        else:
            truth = self.truth(alternative, env)
        if edge is not None and not self.causal:
            truth = moment.begun_between(truth, self.clock.coarse)
        return band.crisp(truth.sure, truth.sure == truth.possible)

    def atom(self, atom: ast.Atom, env: Env, wanted: Bool | None = None) -> Band:
        """One entry of a condition; ``wanted`` as in ``condition``."""
        if type(atom) is ast.SignalAtom:
            if wanted is not None and self.costly.asked(atom):
                return self._limited(atom, env, wanted)
            key = (id(atom), self._obligation, *env.items())
            return self.once(atom, key, self._limited, atom, env, None)
        if type(atom) is ast.StateAtom:
            state = self.must_not(atom.call, env, "forbid" if atom.want else "require", wanted)
            return state if atom.want else band.opposite(state)
        if type(atom) is ast.PastAtom or type(atom) is ast.PairAtom:
            compared = self.of_states(atom, env)
            return compared if atom.want else band.opposite(compared)
        if type(atom) is ast.CountAtom:
            each = [
                self.state(atom.call, {**env, atom.role: body}, wanted)
                for body in self.players.get(atom.role, ())
            ]
            if atom.bound == "least":
                return band.at_least(atom.count, each, self.frames)
            return band.opposite(band.at_least(atom.count + 1, each, self.frames))
        assert type(atom) is ast.AnyOf
        return self._any(atom.alternatives, env, wanted)

    def of_states(self, atom: ast.PastAtom | ast.PairAtom, env: Env) -> Band:
        """(T,) states as they were, or two that are compared; whether that is wanted or not."""
        key = ("of states", id(atom), self._obligation, *env.items())
        return self.once(atom, key, self._of_states, atom, env)

    def _of_states(self, atom: ast.PastAtom | ast.PairAtom, env: Env) -> Band:
        def held(call: ast.Call) -> Band:
            if isinstance(atom, ast.PairAtom):
                return self.must_not(call, env)
            return self.must_not(call, env, "forbid" if atom.want else "require")

        return self.made_of(atom, held)

    def made_of(self, atom: ast.PastAtom | ast.PairAtom, held: Callable[[ast.Call], Band]) -> Band:
        """(T,) the same, from what tells when each of the states held."""
        if isinstance(atom, ast.PairAtom):
            return past.alike(held(atom.call), held(atom.other))
        at = self.looks(atom)
        if atom.begun is not None:
            return past.since(held(atom.call), held(atom.begun), at)
        return (past.once if atom.how == "once" else past.always)(held(atom.call), at)

    def looks(self, atom: ast.PastAtom) -> past.Looks:
        """The samples at which it looks back, from each."""
        recent = lasting(self.duration(atom.recent), 0)
        far = None if atom.far is None else lasting(self.duration(atom.far), 0)
        return past.looks(self.clock, recent, far)

    def _any(
        self,
        alternatives: Sequence[ast.Alternative],
        env: Env,
        wanted: Bool | None,
        *,
        once: bool = False,
    ) -> Band:
        """One of several; what is costly is asked for only where no other one holds already.

        ``once``: what held with certainty is not asked for again later.
        """
        if not any(map(self.costly.asked, alternatives)):
            return band.either(
                [self.alternative(a, env, wanted) for a in alternatives], self.frames
            )
        mask = np.ones(self.frames, np.bool_) if wanted is None else wanted
        bands: list[Band] = []
        for one in self.costly.sorted(alternatives):
            bands.append(self.alternative(one, env, mask))
            holds = bands[-1].true if self._signs else bands[-1].lower == np.inf
            mask = mask & ~(np.logical_or.accumulate(holds) if once else holds)
        return band.either(bands, self.frames)

    def _limited(self, atom: ast.SignalAtom, env: Env, wanted: Bool | None) -> Band:
        """Margins of a signal's limits; ``wanted`` as in ``condition``."""
        measurement = self.asked(atom, env)
        series = self.measured_series(measurement, atom, env, wanted)
        if self._obligation is not None and self.exempt(measurement):
            skipped = not self._forbidding()
            return band.crisp(np.full(self.frames, skipped), np.ones(self.frames, np.bool_))
        return self.margins(series, atom, measurement)

    def margins(self, series: Series, atom: ast.SignalAtom, measurement: Asked) -> Band:
        """(N,) of what an atom asks for, from its signal at N frames."""
        scale = self.scale(atom.call)
        if len(atom.limits) == 1:
            return limit_margin(series, atom.limits[0].op, measurement.limits[0], scale)
        return band.both(
            [
                limit_margin(series, limit.op, number, scale)
                for limit, number in zip(atom.limits, measurement.limits, strict=True)
            ],
            len(series),
        )

    def exempt(self, measurement: Asked) -> bool:
        """The body has no such quantity: a ball has no tilt."""
        computed = self.rules.derived.get(measurement.name)
        if computed is not None:
            return self.lacks_operand(computed, measurement.bodies)
        has_none = self.signal(measurement.name).exempt
        body = self.episode.bodies.get(measurement.bodies[0]) if measurement.bodies else None
        return has_none is not None and body is not None and has_none(body)

    def _deep(self, call: ast.Call | None) -> bool:
        """A declared state that asks for something costly."""
        state = None if call is None else self.rules.states.get(call.name)
        return state is not None and self.costly.state(state)

    def _signs_at(self, call: ast.Call, env: Env, wanted: Bool) -> Truth:
        """Whether such a state holds at the wanted frames; at others as far as it is known."""
        return truth_of(self.only_signs(self.state, call, env, wanted))
