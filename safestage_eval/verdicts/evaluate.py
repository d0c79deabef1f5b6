"""Conditions, states and events of the rule language over one episode."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, TypeVar, cast

import numpy as np

from safestage_eval.relations.measure import COSTLY, Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import digest_of
from safestage_eval.signals.reference import Reference, latest
from safestage_eval.signals.series import Series
from safestage_eval.states import band, moment, persistence
from safestage_eval.states.band import Band, Bool
from safestage_eval.states.moment import Moment, Truth, truth_of
from safestage_eval.states.scope import Scope

from .costly import Costly, is_costly
from .known import Known
from .memory import Memory
from .values import Env, Values, ends_early, ends_with_success, limit_margin

Found = TypeVar("Found")

Bounds = tuple[float, float]


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
        self.at_hand: dict[str, Any] | None = None
        """Answers about the rule that is being judged, where they are collected."""
        self.bounds: Callable[[str, ast.Alternative, Env, Scope], Bounds | None] | None = None
        """Margin of an obligation in a scope, where it can be told without its frames."""
        self._obligation: str | None = None
        self._known = Known(rules)
        self._costly = Costly(rules)
        self._digests: dict[Any, tuple[object, str]] = {}

    def digest(self, node: object) -> str:
        """Of a part of a rule, as it holds under these values."""
        key = tuple(map(id, node)) if isinstance(node, tuple) else id(node)
        known = self._digests.get(key)
        if known is None:
            backend = self.relations.signals.backend
            known = node, digest_of(self.rules, node, self.params, backend)
            self._digests[key] = known
        return known[1]

    def under(self, params: Mapping[str, ast.Quantity | ast.Duration]) -> Evaluator:
        """The same episode under other values; what they cannot change is shared."""
        found = Evaluator(
            self.relations,
            self.rules,
            params,
            self.success,
            success_known=self.success_known,
            causal=self.causal,
            memory=self.memory,
        )
        found.players, found.at_hand = self.players, self.at_hand
        found._measured = self._measured  # no value of a parameter is in it
        changed = {name for name, value in params.items() if self.params.get(name) != value}
        found._known = Known(self.rules, self._known, frozenset(changed))
        return found

    def once(self, node: object, key: tuple[Any, ...], find: Callable[[], Found]) -> Found:
        """What ``find`` says of a declared part of the rules, with its notes; or what it said before.

        Args:
            node: the part, kept beside what was found, and so stays what it is.
            key: what else the answer depends on, and who asks.
            find: tells it.
        """
        known = self._known.get(key)
        if known is None:
            outer, self.notes = self.notes, {}
            try:
                known = self._known.told[key] = node, find(), self.notes
            finally:
                self.notes = outer
        self.notes.update(known[2])
        return cast(Found, known[1])

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
        found = self.relations.signal(
            name, bodies, reference, reach_of(limits), wanted, options, limits
        )
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
        if not self._costly.within(condition):
            return band.both([self.atom(atom, env) for atom in condition.atoms], self.frames)
        mask = np.ones(self.frames, np.bool_) if wanted is None else wanted
        bands: list[Band] = []
        decided = 0  # how many of them the mask knows of
        for atom in sorted(condition.atoms, key=is_costly):
            if self._costly.asked(atom):
                for found in bands[decided:]:
                    mask = mask & ~np.isneginf(found.upper)
                decided = len(bands)
            bands.append(self.atom(atom, env, mask))
        return band.both(bands, self.frames)

    def asks_costly(self, what: ast.Alternative) -> bool:
        """Where it is asked for makes a difference: something in it is costly."""
        return self._costly.asked(what)

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
            if wanted is not None and self._costly.asked(atom):
                return self._limited(atom, env, wanted)
            key = (id(atom), self._obligation, *env.items())
            return self.once(atom, key, lambda: self._limited(atom, env, None))
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
        if len(atom.limits) == 1:
            (only,) = atom.limits
            return limit_margin(series, only.op, self.number(only.value, env), scale)
        return band.both(
            [limit_margin(series, x.op, self.number(x.value, env), scale) for x in atom.limits],
            self.frames,
        )

    def _has_no_tilt(self, call: ast.Call, env: Env) -> bool:
        name, bodies, _ = self.measured(call, env)
        return name == "tilt" and self.untilted(bodies[0])

    def untilted(self, name: str) -> bool:
        """A body that has no up axis, and so no tilt."""
        body = self.episode.bodies.get(name)
        return body is not None and body.up_axis is None and "up_axis" not in body.untold

    def found(self, name: str, bodies: tuple[str, ...]) -> tuple[Band, dict[str, None]] | None:
        """Margins and notes of a state or relation that was asked for before at all frames."""
        known = self._known.get(("state", name, bodies))
        return None if known is None else known[1:]

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
        if wanted is not None and declared is not None and self._costly.named(declared):
            inner = dict(zip(declared.of, bodies, strict=True))
            return self.condition(declared.when, inner, wanted)
        if wanted is not None and declared is None and call.name in COSTLY:
            return self._relation(call.name, bodies, wanted)
        key = ("state", call.name, bodies)
        if declared is None:
            return self.once(None, key, lambda: self._relation(call.name, bodies))
        return self.once(declared, key, lambda: self._declared(call.name, bodies))

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
        state, key = self.rules.states[name], ("momentary", name, bodies)
        return self.once(state, key, lambda: self._momentary(state, bodies))

    def _momentary(self, state: ast.StateDef, bodies: tuple[str, ...]) -> Band:
        env = dict(zip(state.of, bodies, strict=True))
        found = self.condition(state.when, env)
        if state.fallback is None or found.told:
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


def reach_of(limits: Sequence[float]) -> float:
    """Up to where a signal is wanted exactly: a limit is never where it saturates."""
    return max(abs(limit) for limit in limits) * (1 + 1e-6) + 1e-6
