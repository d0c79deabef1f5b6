"""Conditions and states of a rule as keys: their truth at a value of one parameter, and up to where.

What does not read the parameter is asked of the evaluator, and never changes. What does is built of
minima and maxima, as the evaluator builds it of margins (``verdicts.evaluate``, whose meaning this
follows part by part); a part that has no such form raises ``Undecided``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from safestage_eval.episode import Window
from safestage_eval.evidence.series import Series
from safestage_eval.geometry.gjk import PROMISED
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import ClauseKind
from safestage_eval.rules.digest import parameters_read
from safestage_eval.states import band, persistence
from safestage_eval.states.band import Band, Bool
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.values import Env, lasting

from .flip_keys import Way, certain, clipped, compared, fixed, latched, steady
from .flip_lasting import Counts, Undecided, closed_keys, lasting_keys, steps_from

Kind = ClauseKind | None
ROUNDING = 2 * PROMISED
"""M, by which a distance that is measured anew may differ."""

BEYOND = 1e3
"""M; no distance that is measured is as large."""


class FlipBands:
    """The rule language on one episode, at one value of a parameter that moves one way."""

    def __init__(
        self,
        base: Evaluator,
        at: Evaluator,
        param: str,
        value: float,
        way: Way,
        counts: Counts,
        further: float,
    ) -> None:
        """Prepare; nothing is computed yet.

        Args:
            base: the evaluator under the values that hold; it is asked what does not depend on the
                parameter, and remembers.
            at: the evaluator under this value.
            param: name of the parameter.
            value: of it.
            way: in which it moves.
            counts: samples that it takes as a duration.
            further: m, up to where distances are wanted.
        """
        self.base, self.at = base, at
        self.param, self.value, self.way = param, value, way
        self.counts = counts
        self.frames = at.frames
        self._further = further
        self._states: dict[tuple[str, tuple[str, ...]], Band] = {}
        self.capped = False
        """A distance was compared with the parameter, and is known only so far."""

    def reads(self, node: object) -> bool:
        """A part of the rules depends on the parameter."""
        return node is not None and self.param in parameters_read(self.at.rules, node)

    def is_moved(self, value: object) -> bool:
        """It is the parameter itself."""
        return isinstance(value, ast.Parameter) and value.name == self.param

    # ---- conditions

    def alternative(self, what: ast.Alternative, env: Env, kind: Kind, wanted: Bool) -> Band:
        """(T,) a condition or event in an obligation of some kind; only ``wanted`` frames count."""
        if not self.reads(what):
            return self._given(self.base.alternative, what, env, kind, wanted)
        if isinstance(what, ast.Condition):
            return self.condition(what, env, kind, wanted)
        assert what.call is not None
        if what.edge is None:
            return self._must_not(what.call, env, kind, "forbid")
        if what.edge == "start" and kind == "forbid":
            return _edge(self._must_not(what.call, env, kind, "forbid"), "start")
        return _edge(self.state(what.call, env), what.edge)

    def condition(self, condition: ast.Condition, env: Env, kind: Kind, wanted: Bool) -> Band:
        """(T,) all of it holds; what is costly is asked for where nothing else rules it out."""
        bands, mask = list[Band](), wanted
        for atom in self.at.costly.sorted(condition.atoms):
            bands.append(self.atom(atom, env, kind, mask))
            mask = mask & (bands[-1].upper != -np.inf)
        return band.both(bands, self.frames)

    def atom(self, atom: ast.Atom, env: Env, kind: Kind, wanted: Bool) -> Band:
        """(T,) one entry of a condition."""
        if not self.reads(atom):
            return self._given(self.base.atom, atom, env, kind, wanted)
        if isinstance(atom, ast.SignalAtom):
            return self._compared(atom, env, kind, wanted)
        if isinstance(atom, ast.StateAtom):
            keys = self._must_not(atom.call, env, kind, "forbid" if atom.want else "require")
            return keys if atom.want else band.opposite(keys)
        if isinstance(atom, ast.CountAtom):
            players = self.at.players.get(atom.role, ())
            each = [self.state(atom.call, {**env, atom.role: body}) for body in players]
            least = atom.bound == "least"
            keys = band.at_least(atom.count + (not least), each, self.frames)
            return keys if least else band.opposite(keys)
        if isinstance(atom, ast.PastAtom | ast.PairAtom):
            return self._of_states(atom, env, kind)
        bands, mask = list[Band](), wanted
        for one in self.at.costly.sorted(atom.alternatives):
            bands.append(self.alternative(one, env, kind, mask))
            mask = mask & (bands[-1].lower != np.inf)
        return band.either(bands, self.frames)

    def _of_states(self, atom: ast.PastAtom | ast.PairAtom, env: Env, kind: Kind) -> Band:
        """(T,) states as they were, or two that are compared."""
        if isinstance(atom, ast.PastAtom) and (
            self.is_moved(atom.recent) or self.is_moved(atom.far)
        ):
            raise Undecided("how far it looks back depends on it")
        if isinstance(atom, ast.PairAtom) and kind is not None:
            raise Undecided("what may be too brief to count matters both ways")
        breaks: ClauseKind = "forbid" if atom.want else "require"
        keys = self.at.made_of(atom, lambda call: self._must_not(call, env, kind, breaks))
        return keys if atom.want else band.opposite(keys)

    def _given(
        self, find: Callable[..., Band], node: object, env: Env, kind: Kind, wanted: Bool
    ) -> Band:
        """(T,) what does not depend on the parameter."""
        if not self.base.asks_costly(node):  # type: ignore[arg-type]
            return fixed(self.base.obliged(kind, find, node, env))
        if not wanted.any():
            nothing = certain(wanted)
            return Band(nothing, nothing)
        return fixed(self.base.only_signs(self.base.obliged, kind, find, node, env, wanted))

    def _compared(self, atom: ast.SignalAtom, env: Env, kind: Kind, wanted: Bool) -> Band:
        """(T,) limits of a signal, one of which is the parameter."""
        if self.reads(atom.call):
            raise Undecided("it changes what is measured")
        measurement = self.at.asked(atom, env)
        if kind is not None and self.at.exempt(measurement):
            return fixed(band.crisp(np.full(self.frames, kind != "forbid")))
        bands = [
            self._limit(limit, number, self._series(atom, env, measurement.name, wanted))
            for limit, number in zip(atom.limits, measurement.limits, strict=True)
        ]
        keys = band.both(bands, self.frames)
        if atom.since is not None and self.reads(atom.since):
            keys = clipped(keys, steady(self.event(atom.since, env)))
        return keys

    def _series(self, atom: ast.SignalAtom, env: Env, name: str, wanted: Bool) -> Series:
        if not self.at.signal(name).capped:
            if atom.since is not None and self.at.since(atom.since, env)[1] is not None:
                raise Undecided("what it is measured from is not known")
            return self.at.series(atom, env, wanted if self.at.asks_costly(atom) else None)
        self.capped = True
        _, bodies, options, _, _ = self.at.asked(atom, env)
        others = [
            self.at.number(limit.value, env)
            for limit in atom.limits
            if not self.is_moved(limit.value)
        ]
        # a limit beyond all distances: bounds stay as wide as they may be
        series = self.at.relations.signal(
            name, bodies, None, self._further, None, options, (BEYOND, *others)
        )
        # measured for another limit, a distance may come out as another number within its bounds
        return replace(series, lower=series.lower - ROUNDING, upper=series.upper + ROUNDING)

    def _limit(self, limit: ast.Limit, number: float, series: Series) -> Band:
        up = limit.op[0] == ">"
        first, second = (series.lower, series.upper) if up else (series.upper, series.lower)
        if self.is_moved(limit.value):
            negative = isinstance(limit.value, ast.Parameter) and limit.value.negative
            ends = [
                compared(end, limit.op, self.value, self.way, negative) for end in (first, second)
            ]
            return Band(ends[0], ends[0] if first is second else ends[1])
        test = {">=": np.greater_equal, ">": np.greater, "<=": np.less_equal, "<": np.less}[
            limit.op
        ]
        return Band(certain(test(first, number)), certain(test(second, number)))

    # ---- states

    def _must_not(self, call: ast.Call, env: Env, kind: Kind, breaks: ClauseKind) -> Band:
        """(T,) a state, as an obligation that breaks where it holds sees it (``Evaluator.must_not``)."""
        if not self.reads(call):
            everywhere = np.ones(self.frames, np.bool_)
            holds = ast.StateAtom(call, True)
            must_not = self.base.must_not
            if self.base.asks_costly(holds):
                return fixed(
                    self.base.only_signs(
                        self.base.obliged, kind, must_not, call, env, breaks, everywhere
                    )
                )
            return fixed(self.base.obliged(kind, must_not, call, env, breaks))
        strict, state = self.state(call, env), self.at.rules.states[call.name]
        if kind is None or kind != breaks or state.for_ is None or state.until is not None:
            return strict
        lasts, window = lasting(self.at.duration(state.for_)), self.at.window(state.for_)
        if window.loose is window or lasts.seconds is None:
            return strict
        if self.at.clock.longest >= lasts.seconds * (1 - 1e-6) or self.is_moved(state.gap):
            raise Undecided("it may hold between two samples")
        loose = persistence.persistent(
            self._momentary(state, self._inner(state, call, env)), window.loose,
            self.at.open_gap(state.gap), open_end=self.at.unfollowed,
        )  # fmt: skip
        return Band(strict.lower, np.maximum(strict.upper, loose.upper))

    def state(self, call: ast.Call, env: Env) -> Band:
        """(T,) a declared state or relation, persistent and latched as declared."""
        key = call.name, tuple(env.get(arg, arg) for arg in call.args)
        if key not in self._states:
            self._states[key] = self._state(call, env)
        return self._states[key]

    def _state(self, call: ast.Call, env: Env) -> Band:
        everywhere = np.ones(self.frames, np.bool_)
        if not self.reads(call):
            if self.at.asks_costly(ast.StateAtom(call, True)):
                return fixed(self.base.only_signs(self.base.state, call, env, everywhere))
            return fixed(self.base.obliged(None, self.base.state, call, env))
        state = self.at.rules.states[call.name]
        inner = self._inner(state, call, env)
        keys = self._persistent(state, self._momentary(state, inner))
        if state.also is not None:
            parts = [
                one
                for atom in state.also.atoms
                for one in (atom.alternatives if isinstance(atom, ast.AnyOf) else (atom,))
                if self._any_known(one, inner)
            ]
            more = [
                self.alternative(one, inner, None, everywhere)
                if isinstance(one, ast.Condition | ast.Event)
                else self.atom(one, inner, None, everywhere)
                for one in parts
            ]
            keys = band.either([keys, *more], self.frames)
        if state.until is None:
            return keys
        reset = self.event(state.until, inner)
        lower = latched(keys.lower, -reset.upper)
        if keys.exact and reset.exact:
            return Band(lower, lower)
        return Band(lower, latched(keys.upper, -reset.lower))

    @staticmethod
    def _inner(state: ast.StateDef, call: ast.Call, env: Env) -> Env:
        return dict(zip(state.of, (env.get(arg, arg) for arg in call.args), strict=True))

    def _any_known(self, part: ast.Atom | ast.Alternative, env: Env) -> bool:
        """Whether the trace has what it needs at some frame, whatever the parameter."""
        at = self.at
        if isinstance(part, ast.Condition | ast.Event):
            return at.obliged(None, at.alternative, part, env).any_known
        return at.obliged(None, at.atom, part, env).any_known

    def _momentary(self, state: ast.StateDef, env: Env) -> Band:
        everywhere = np.ones(self.frames, np.bool_)
        if state.fallback is None or self._any_known(state.when, env):
            return self.condition(state.when, env, None, everywhere)
        instead = self.condition(state.fallback, env, None, everywhere)
        if state.perhaps is None:
            return instead
        perhaps = self.condition(state.perhaps, env, None, everywhere)
        return Band(instead.lower, np.maximum(instead.upper, perhaps.upper))

    def _persistent(self, state: ast.StateDef, keys: Band) -> Band:
        open_end = self.at.unfollowed
        moved = [self.is_moved(part) for part in (state.for_, state.gap)]
        if not any(moved):
            return persistence.persistent(
                keys, self.at.window(state.for_), self.at.open_gap(state.gap), open_end=open_end
            )
        if all(moved) or (moved[1] and (self.reads(state.when) or open_end)):
            raise Undecided("several of its durations depend on it")
        if moved[1]:
            ends = [closed_keys(end, self.counts, self.value, self.way) for end in keys]
            return persistence.persistent(
                Band(*ends), self.at.window(state.for_), 0, open_end=open_end
            )
        counts, gap = self.counts, self.at.open_gap(state.gap)
        if self.reads(state.when):
            return self._lasting(keys, gap, counts, open_end=open_end)
        closed = persistence.persistent(keys, 1, gap, open_end=open_end)
        ends = [
            lasting_keys(end, counts, self.value, self.way, open_end=open_end and perhaps)
            for end, perhaps in zip(closed, (False, True), strict=True)
        ]
        return Band(*ends)

    def _lasting(self, keys: Band, gap: Window, counts: Counts, *, open_end: bool) -> Band:
        """(T,) what lasts for the parameter, and itself depends on it.

        What lasts for n samples lasts for every duration that takes no more, and what does not
        lasts for none that takes as many: each of some n gives a key, and the furthest counts.
        """
        out: Band | None = None
        for frames in steps_from(counts.frames(self.value), self.frames, self.way):
            one = persistence.persistent(keys, frames, gap, open_end=open_end)
            bound = counts.size(frames, self.way)
            if self.way == "up":
                ends = [np.minimum(end, bound) for end in one]
                out = Band(*ends) if out is None else Band(*map(np.maximum, out, ends))
            else:
                ends = [np.maximum(end, -bound) for end in one]
                out = Band(*ends) if out is None else Band(*map(np.minimum, out, ends))
        assert out is not None
        return out

    # ---- events

    def event(self, event: ast.Event, env: Env) -> Band:
        """(T,) the frames of an event; of a bare state, all where it holds."""
        if event.kind == "state" and event.call is not None and self.reads(event.call):
            keys = self.state(event.call, env)
            return keys if event.edge is None else _edge(keys, event.edge)
        truth = self.base.obliged(None, self.base.truth, event, env)
        return Band(certain(truth.sure), certain(truth.possible))


def _edge(now: Band, edge: str) -> Band:
    """Where something starts to hold, or has just ended to; nothing holds before the first frame."""
    then = Band(*(np.concatenate([[-np.inf], end[:-1]]) for end in now))
    first, second = (now, then) if edge == "start" else (then, now)
    return Band(np.minimum(first.lower, -second.upper), np.minimum(first.upper, -second.lower))
