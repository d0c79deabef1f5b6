"""Conditions, states and events of the rule language over one episode."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np

from safestage_eval.relations.measure import COSTLY, Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import parameters_read
from safestage_eval.signals.reference import Reference, latest
from safestage_eval.signals.series import Series
from safestage_eval.states import band, moment, persistence
from safestage_eval.states.band import Band, Bool
from safestage_eval.states.moment import Moment, Truth, truth_of

from .memory import Memory
from .values import Env, Values, ends_early, ends_with_success, limit_margin


class Evaluator(Values):
    """The rule language's meaning on one episode, under one set of parameter values.

    Every condition becomes a ``Band`` of normalised margins, every event a ``Truth``: the frames at
    which it certainly is, and those at which it may be.
    """

    def __init__(
        self,
        relations: Relations,
        rules: ast.RuleSet,
        params: Mapping[str, ast.Quantity | ast.Duration],
        success: int | None,
        *,
        success_known: bool = True,
        causal: bool = False,
        memory: Memory | None = None,
    ) -> None:
        """Prepare; nothing is computed yet.

        Args:
            relations: facts of the episode.
            rules: where states, phases, signals and materials are declared.
            params: name → value in SI, as they hold for the rule and episode.
            success: frame that confirmed native success, None if it never came.
            success_known: False where the trace does not tell; then nothing after it is known.
            causal: states look only backwards, as in a rollout that is still running.
            memory: where answers from before are found.
        """
        super().__init__(relations, rules, params)
        self.success = success
        self.success_known = success_known
        self.causal = causal
        self.memory = memory
        self.frames = len(self.episode)
        self.truncated = ends_early(self.episode)
        self.unfollowed = self.truncated or ends_with_success(self.episode)
        self.notes: dict[str, None] = {}
        self.players: Mapping[str, Sequence[str]] = {}
        """Role → all bodies that play it, for ``at least K role``."""
        self._obligation: str | None = None
        self._states: dict[tuple[str, tuple[str, ...]], tuple[Band, dict[str, None]]] = {}
        # by identity: what is asked about is kept beside what was found, and so stays what it is
        self._limits: dict[tuple[Any, ...], tuple[ast.SignalAtom, Band, dict[str, None]]] = {}
        self._lazy: dict[int, tuple[ast.Condition, bool]] = {}

    def under(self, params: Mapping[str, ast.Quantity | ast.Duration]) -> Evaluator:
        """The same episode under other values; states and limits that they cannot change are shared."""
        found = Evaluator(
            self.relations,
            self.rules,
            params,
            self.success,
            success_known=self.success_known,
            causal=self.causal,
            memory=self.memory,
        )
        found.players = self.players
        changed = {name for name, value in params.items() if self.params.get(name) != value}

        def same(node: object) -> bool:
            return changed.isdisjoint(parameters_read(self.rules, node))

        for call, state in self._states.items():
            declared = self.rules.states.get(call[0])
            if declared is None or same(declared):
                found._states[call] = state
        found._limits = {key: known for key, known in self._limits.items() if same(known[0])}
        return found

    @contextmanager
    def obliged(self, kind: str | None) -> Iterator[None]:
        """Conditions are those of a rule's ``require``, ``forbid`` or ``reach``; None for a state.

        A limit on a tilt that a body does not have is skipped there: it holds where it must, and
        does not where it must not. A state asks whether the body is tilted, and it never is.
        """
        outer, self._obligation = self._obligation, kind
        try:
            yield
        finally:
            self._obligation = outer

    # ---- conditions

    def series(self, atom: ast.SignalAtom, env: Env, wanted: Bool | None = None) -> Series:
        """The signal of an atom, up to where its limits need it exactly, at the wanted frames."""
        name, bodies, options = self.measured(atom.call, env)
        reference = None
        if atom.since is not None:
            when = moment.frames_of(self.moments(atom.since, env), self.frames)
            instants = np.flatnonzero(when.possible)
            reference = Reference(
                self.relations.signals.baseline,
                latest(instants, self.frames),
                key=f"since {instants.tobytes().hex()}",
            )
        limits = [self.number(limit.value, env) for limit in atom.limits]
        furthest = max(abs(limit) for limit in limits)
        reach = furthest * (1 + 1e-6) + 1e-6  # a limit is never where the signal saturates
        found = self.relations.signal(name, bodies, reference, reach, wanted, options, limits)
        for note in found.notes:
            self.notes[note] = None
        if atom.since is None or when.known:
            return found
        newest = np.maximum.accumulate(np.where(when.possible, np.arange(self.frames), -1))
        open_ = (newest >= 0) & ~when.sure[newest]
        lower, upper = np.where(open_, -np.inf, found.lower), np.where(open_, np.inf, found.upper)
        return replace(found, lower=lower, upper=upper)

    def condition(self, condition: ast.Condition, env: Env, wanted: Bool | None = None) -> Band:
        """All atoms hold.

        Only the ``wanted`` frames (T,) of the result mean anything; all of them if None. Costly
        signals come last, and are measured only where no other atom has already decided.
        """
        if not self._is_lazy(condition):
            return band.both([self.atom(atom, env) for atom in condition.atoms], self.frames)
        mask = np.ones(self.frames, np.bool_) if wanted is None else wanted
        bands: list[Band] = []
        decided = 0  # how many of them the mask knows of
        for atom in sorted(condition.atoms, key=_is_costly):
            if self._asks_costly(atom):
                for found in bands[decided:]:
                    mask = mask & ~np.isneginf(found.upper)
                decided = len(bands)
            bands.append(self.atom(atom, env, mask))
        return band.both(bands, self.frames)

    def _is_lazy(self, condition: ast.Condition) -> bool:
        """It asks for something costly, itself or through a state that merely names a condition."""
        known = self._lazy.get(id(condition))
        if known is None:
            known = self._lazy[id(condition)] = (
                condition,
                any(self._asks_costly(atom) for atom in condition.atoms),
            )
        return known[1]

    def _asks_costly(self, asked: ast.Atom | ast.Alternative) -> bool:
        if isinstance(asked, ast.Condition):
            return self._is_lazy(asked)
        if isinstance(asked, ast.AnyOf):
            return any(self._asks_costly(a) for a in asked.alternatives)
        if isinstance(asked, ast.Event) and asked.edge is not None:
            return False
        if asked.call is None:
            return False
        name = asked.call.name
        if name in self.rules.signals:
            name = self.rules.signals[name].base
        declared = self.rules.states.get(name)
        if declared is not None and _is_momentary(declared):
            return self._is_lazy(declared.when)
        return name in COSTLY

    def alternative(
        self, alternative: ast.Alternative, env: Env, wanted: Bool | None = None
    ) -> Band:
        """A condition, or the frames of an event; ``wanted`` as in ``condition``."""
        if isinstance(alternative, ast.Condition):
            return self.condition(alternative, env, wanted)
        if alternative.kind == "state" and alternative.edge is None and alternative.call:
            return self.state(alternative.call, env, wanted)
        found = self.truth(alternative, env)
        return band.crisp(found.sure, found.sure == found.possible)

    def atom(self, atom: ast.Atom, env: Env, wanted: Bool | None = None) -> Band:
        """One entry of a condition; ``wanted`` as in ``condition``."""
        if isinstance(atom, ast.SignalAtom):
            if wanted is not None and self._asks_costly(atom):
                return self._limited(atom, env, wanted)
            key = (id(atom), self._obligation, *env.items())
            if key not in self._limits:
                outer, self.notes = self.notes, {}
                self._limits[key] = atom, self._limited(atom, env, None), self.notes
                self.notes = outer
            _, found, notes = self._limits[key]
            self.notes.update(notes)
            return found
        if isinstance(atom, ast.StateAtom):
            found = self.state(atom.call, env, wanted)
            return found if atom.want else band.opposite(found)
        if isinstance(atom, ast.CountAtom):
            each = [
                self.state(atom.call, {**env, atom.role: body}, wanted)
                for body in self.players.get(atom.role, ())
            ]
            if atom.bound == "least":
                return band.at_least(atom.count, each, self.frames)
            return band.opposite(band.at_least(atom.count + 1, each, self.frames))
        return band.either(
            [self.alternative(a, env, wanted) for a in atom.alternatives], self.frames
        )

    def _limited(self, atom: ast.SignalAtom, env: Env, wanted: Bool | None) -> Band:
        """Margins of a signal's limits; ``wanted`` as in ``condition``."""
        series = self.series(atom, env, wanted)
        if self._obligation is not None and self._has_no_tilt(atom.call, env):
            skipped = self._obligation != "forbid"
            return band.crisp(np.full(self.frames, skipped), np.ones(self.frames, np.bool_))
        scale = self.scale(atom.call)
        return band.both(
            [limit_margin(series, x.op, self.number(x.value, env), scale) for x in atom.limits],
            self.frames,
        )

    def _has_no_tilt(self, call: ast.Call, env: Env) -> bool:
        name, bodies, _ = self.measured(call, env)
        body = self.episode.bodies.get(bodies[0]) if name == "tilt" else None
        return body is not None and body.up_axis is None and "up_axis" not in body.untold

    def state(self, call: ast.Call, env: Env, wanted: Bool | None = None) -> Band:
        """A declared state or a built-in relation, persistent and latched as declared.

        ``wanted`` as in ``condition``; a state that looks at neighbouring frames has them all.
        """
        outer, self._obligation = self._obligation, None
        try:
            return self._state(call, env, wanted)
        finally:
            self._obligation = outer

    def _state(self, call: ast.Call, env: Env, wanted: Bool | None) -> Band:
        bodies = tuple(env.get(arg, arg) for arg in call.args)
        declared = self.rules.states.get(call.name)
        if wanted is not None and declared is not None and _is_momentary(declared):
            inner = dict(zip(declared.of, bodies, strict=True))
            return self.condition(declared.when, inner, wanted)
        if wanted is not None and declared is None and call.name in COSTLY:
            return self._relation(call.name, bodies, wanted)
        key = (call.name, bodies)
        if key not in self._states:
            outer, self.notes = self.notes, {}
            if declared is None:
                found = self._relation(call.name, bodies)
            else:
                found = self._declared(call.name, bodies)
            self._states[key] = (found, self.notes)
            self.notes = outer
        found, notes = self._states[key]
        self.notes.update(notes)
        return found

    def _relation(self, name: str, bodies: tuple[str, ...], wanted: Bool | None = None) -> Band:
        truth = self.relations.get(name, bodies, wanted)
        if truth is None:
            lacking = self.relations.lacking(name, bodies) or "shapes"
            self.notes[f"{name}() cannot be told: the trace has no {lacking}"] = None
            nothing = np.zeros(self.frames, np.bool_)
            return band.crisp(nothing, nothing)
        self.notes.update(dict.fromkeys(self.relations.caveat(name)))
        doubtful = self.relations.doubtful(name, bodies)
        if doubtful is not None:
            where, why = doubtful
            wanted = ~where if wanted is None else wanted & ~where
            self.notes[why] = None
        return band.crisp(truth, wanted)

    def momentary(self, name: str, bodies: tuple[str, ...]) -> Band:
        """What a declared state is made of, before it is made to last; its fallback if need be."""
        state = self.rules.states[name]
        env = dict(zip(state.of, bodies, strict=True))
        found = self.condition(state.when, env)
        if state.fallback is None or band_known(found):
            return found
        found = self.condition(state.fallback, env)
        if state.perhaps is None:
            return found
        return Band(found.lower, np.maximum(found.upper, self.condition(state.perhaps, env).upper))

    def _declared(self, name: str, bodies: tuple[str, ...]) -> Band:
        state = self.rules.states[name]
        env = dict(zip(state.of, bodies, strict=True))
        found = self.momentary(name, bodies)
        found = persistence.persistent(
            found,
            self.count(state.for_) if state.for_ is not None else 1,
            self.count(state.gap, least=0) if state.gap is not None else 0,
            causal=self.causal,
            open_end=self.unfollowed,
        )
        if state.until is not None:
            found = persistence.latched(found, *self.truth(state.until, env))
        return found

    # ---- events

    def truth(self, event: ast.Event, env: Env) -> Truth:
        """The frames of an event; of a bare state, all frames where it holds.

        ``end`` comes after the last frame and so has none.
        """
        if event.kind == "state" and event.call is not None:
            now = truth_of(self.state(event.call, env))
            if event.edge is None:
                return now
            before = Truth(*(np.concatenate([[False], part[:-1]]) for part in now))
            if event.edge == "start":
                return Truth(now.sure & ~before.possible, now.possible & ~before.sure)
            return Truth(before.sure & ~now.possible, before.possible & ~now.sure)
        sure, possible = np.zeros(self.frames, np.bool_), np.zeros(self.frames, np.bool_)
        if event.kind == "start":
            sure[:1] = possible[:1] = True
        elif event.kind == "success" and not self.success_known:
            possible[:] = True
        elif event.kind == "success" and self.success is not None:
            sure[self.success] = possible[self.success] = True
        return Truth(sure, possible)

    def moments(self, event: ast.Event, env: Env) -> list[Moment]:
        """When an event happens; a bare state happens where it starts.

        ``end`` comes after the last frame: T.
        """
        if event.kind == "end":
            return [Moment(self.frames, self.frames)]
        if event.kind == "success":
            if not self.success_known:
                return [Moment(0, self.frames - 1, sure=False)]
            return [] if self.success is None else [Moment(self.success, self.success)]
        if event.kind == "start" or event.call is None:
            return [Moment(0, 0)]
        truth = truth_of(self.state(event.call, env))
        return moment.ends(truth) if event.edge == "end" else moment.starts(truth)


def _is_momentary(state: ast.StateDef) -> bool:
    """A mere name for a condition: no frame of it depends on another."""
    return all(part is None for part in (state.for_, state.gap, state.until, state.fallback))


def _is_costly(atom: ast.Atom) -> bool:
    return isinstance(atom, ast.SignalAtom | ast.StateAtom) and atom.call.name in COSTLY


def band_known(found: Band) -> bool:
    """False where nothing is known at any frame."""
    if len(found.lower) and (found.lower[0] > -np.inf or found.upper[0] < np.inf):
        return True
    return not (np.isneginf(found.lower).all() and np.isposinf(found.upper).all())
