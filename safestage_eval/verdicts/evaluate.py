"""Conditions, states and events of the rule language over one episode."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from safestage_eval.episode import Window
from safestage_eval.evidence.declare import is_costly
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import CLAUSES, ClauseKind
from safestage_eval.states import band, moment, persistence
from safestage_eval.states.band import F64, Band, Bool
from safestage_eval.states.moment import Moment, Truth, truth_of

from . import between_samples
from .partial_states import PartialStates
from .values import Env, ends_early, ends_with_success, lacks_its_success, lasting


class Evaluator(PartialStates):
    """The rule language's meaning on one episode, under one set of parameter values.

    Every condition becomes a ``Band`` of normalised margins, every event a ``Truth``: the frames at
    which it certainly is, and those at which it may be.
    """

    def __init__(
        self,
        relations: Relations,
        rules: ast.RuleSet,
        params: ast.Params,
        success: int | None,
        *,
        success_known: bool = True,
        causal: bool = False,
    ) -> None:
        """Prepare; nothing is computed yet.

        Args:
            relations: facts of the episode.
            rules: where states, phases, signals and materials are declared.
            params: name → value in SI, as they hold for the rule and episode.
            success: frame that confirmed native success, None if it never came.
            success_known: False where the trace does not tell; then nothing after it is known.
            causal: states look only backwards, as in a rollout that is still running.
        """
        super().__init__(relations, rules, params, causal=causal)
        self.success = success
        self.success_known = success_known
        cut = success is None and not causal and lacks_its_success(self.episode)
        self.truncated = cut or ends_early(self.episode)
        self.unfollowed = self.truncated or ends_with_success(self.episode)

    def under(self, params: ast.Params) -> Evaluator:
        """Return an evaluator of the episode under other values; shares everything they cannot change."""
        other = Evaluator(
            self.relations,
            self.rules,
            params,
            self.success,
            success_known=self.success_known,
            causal=self.causal,
        )
        other.share(self)
        return other

    # ---- states

    def must_not(
        self,
        call: ast.Call,
        env: Env,
        kind: ClauseKind | None = None,
        wanted: Bool | None = None,
    ) -> Band:
        """A state, as an obligation that breaks where it holds has to see it.

        Where it must last for a few samples of a faster clock ("3 frames @ 120 Hz"), it is unknown
        too where fewer of these samples may have lasted as long, and where two of them may hide it
        between them. In what it means to hold a body, to drop or to free it the samples decide, or
        nothing could be said at the rates of most recordings.

        Args:
            call: the state.
            env: role → body.
            kind: only in obligations that break as this kind does, in any if None; in others, and
                in none, the state stays as it is.
            wanted: as in ``condition``.
        """
        band, state = self.state(call, env, wanted), self.rules.states.get(call.name)
        if self._obligation is None:
            return band
        if kind is not None and CLAUSES[kind].breaks != CLAUSES[self._obligation].breaks:
            return band
        if state is None or state.for_ is None or state.until is not None:
            return band
        lasts, window = lasting(self.duration(state.for_)), self.window(state.for_)
        if window.loose is window or lasts.seconds is None:
            return band
        bodies = tuple(map(env.get, call.args, call.args))
        key = ("must not", call.name, bodies)
        upper = self.once(state, key, self._may_last, state, bodies, lasts.seconds)
        return Band(band.lower, np.maximum(band.upper, upper))

    def _may_last(self, state: ast.StateDef, bodies: tuple[str, ...], seconds: float) -> F64:
        """(T,) upper margin of a state that lasts at least as long as its samples may have."""
        loose = persistence.persistent(
            self.momentary(state.name, bodies),
            self.window(state.for_).loose,
            self.open_gap(state.gap),
            causal=self.causal,
            open_end=self.unfollowed,
        ).upper
        if self.clock.longest < seconds * (1 - 1e-6):
            return loose
        hidden = between_samples.hidden_touch(self, state, bodies, seconds)
        return loose if hidden is None else np.where(hidden, np.inf, loose)

    def state(self, call: ast.Call, env: Env, wanted: Bool | None = None) -> Band:
        """A declared state or a built-in relation, persistent and latched as declared.

        ``wanted`` as in ``condition``; a state that looks at neighbouring frames has them all.
        """
        bodies = tuple(map(env.get, call.args, call.args))
        declared = self.rules.states.get(call.name)
        outer, self._obligation = (self._obligation, self._signs), None
        try:
            if wanted is not None:
                if declared is None:
                    if is_costly(call.name):
                        return self._relation(call.name, bodies, wanted)
                elif (
                    self.costly.state(declared)
                    and ("state", call.name, bodies) not in self._answers
                ):
                    return self._partly(declared, call, bodies, wanted)
            self._signs = False
            find = self._relation if declared is None else self._declared
            return self.once(declared, ("state", call.name, bodies), find, call.name, bodies)
        finally:
            self._obligation, self._signs = outer

    def _relation(self, name: str, bodies: tuple[str, ...], wanted: Bool | None = None) -> Band:
        truth = self.relations.get(name, bodies, wanted)
        if truth is None:
            lacking = self.relations.lacking(name, bodies) or "shapes"
            self.notes[f"{name}() is unknown: the trace has no {lacking}"] = None
            nothing = np.zeros(self.frames, np.bool_)
            return band.crisp(nothing, nothing)
        self.notes.update(dict.fromkeys(self.relations.caveat(name)))
        doubtful, known = self.relations.doubtful(name, bodies, wanted), wanted
        if wanted is not None and is_costly(name):
            known = wanted | self.relations.answered(*bodies)
        if doubtful is not None:
            where, why = doubtful
            known = ~where if known is None else known & ~where
            if why and wanted is None:  # else it hangs on what was asked for
                self.notes[why] = None
        return band.crisp(truth, known)

    def momentary(self, name: str, bodies: tuple[str, ...]) -> Band:
        """The condition of a declared state, before ``for`` and ``gap``; its fallback without forces."""
        state, key = self.rules.states[name], ("momentary", name, bodies)
        return self.once(state, key, self._momentary, state, bodies)

    def _momentary(self, state: ast.StateDef, bodies: tuple[str, ...]) -> Band:
        env = dict(zip(state.of, bodies, strict=True))
        band = self.condition(state.when, env)
        if state.fallback is None or band.any_known:
            return band
        band = self.condition(state.fallback, env)
        if state.perhaps is None:
            return band
        return Band(band.lower, np.maximum(band.upper, self.condition(state.perhaps, env).upper))

    def _declared(self, name: str, bodies: tuple[str, ...]) -> Band:
        state = self.rules.states[name]
        env = dict(zip(state.of, bodies, strict=True))
        state_band = self.momentary(name, bodies)
        state_band = self._persistent(state, state_band)
        if state.also is not None and not self.causal:
            more = band.either([state_band, self.also(state, env)], self.frames)
            holds = state_band.lower >= 0  # then it is not asked whether it was brief
            lower = np.where(holds, state_band.lower, more.lower)
            exact = state_band.exact and more.exact
            state_band = Band(
                lower, lower if exact else np.where(holds, state_band.upper, more.upper)
            )
        if state.until is not None:
            state_band = persistence.latched(state_band, *self.truth(state.until, env))
        return state_band

    def _persistent(self, state: ast.StateDef, band: Band) -> Band:
        """Where the state lasts for long enough; unknown where too few samples, far apart, show it."""
        window, coarse = self.window(state.for_), self.clock.coarse
        lasts = self._lasting(state, band, window)
        lower, upper = lasts.lower, lasts.upper
        if state.gap is not None and coarse.any():  # a gap of one such sample may have been long
            apart = self._lasting(replace(state, gap=None), band, window).lower
            lower = np.where(coarse, np.minimum(lower, apart), lower)
            lasts = Band(lower, upper)
        if state.for_ is None or not coarse.any():
            return lasts
        strict = self.clock.surely(lasting(self.duration(state.for_)))
        surely = self._lasting(state, band, strict).lower
        lower = np.where(coarse, np.minimum(lower, surely), lower)
        if window.loose is not window:
            perhaps = self._lasting(state, band, window.loose).upper
            upper = np.where(coarse, np.maximum(upper, perhaps), upper)
        return Band(lower, upper)

    def _lasting(self, state: ast.StateDef, band: Band, window: Window) -> Band:
        return persistence.persistent(
            band,
            window,
            self.open_gap(state.gap),
            causal=self.causal,
            open_end=self.unfollowed,
        )

    def also(self, state: ast.StateDef, env: Env) -> Band:
        """The ``also`` of a state, which holds however briefly; parts the trace knows nothing of left out."""
        assert state.also is not None
        bands = [
            found
            for atom in state.also.atoms
            for what in (atom.alternatives if isinstance(atom, ast.AnyOf) else (atom,))
            if (found := self._one_of(what, env)).any_known
        ]
        return band.either(bands, self.frames)

    def _one_of(self, what: ast.Alternative | ast.Atom, env: Env) -> Band:
        if isinstance(what, ast.Condition | ast.Event):
            return self.alternative(what, env)
        return self.atom(what, env)

    # ---- events

    @property
    def success_at_sample(self) -> bool:
        """Success came when a sample was taken, as its recorded time says."""
        stated = self.episode.header.success_time
        if stated is None or self.success is None or self.success >= self.frames:
            return False
        return abs(float(self.episode.t[self.success]) - stated) < 1e-6

    def truth(self, event: ast.Event, env: Env) -> Truth:
        """The frames of an event; of a bare state, all frames where it holds.

        ``end`` comes after the last frame and so has none.
        """
        if event.kind == "state" and event.call is not None:
            now = self._truth_of(event.call, env)
            if event.edge is None:
                return now
            return moment.edges(now, event.edge)
        at = np.zeros(self.frames, np.bool_)
        if event.kind == "start":
            at[:1] = True
        elif event.kind == "success" and not self.success_known:
            return Truth(at, ~at)
        elif event.kind == "success" and self.success is not None:
            at[self.success] = True
        return Truth(at, at)

    def holds(self, call: ast.Call, env: Env, since: int = 0) -> Bool:
        """(T,) where a state or relation certainly holds; found out for the frames from ``since`` on."""
        if since and self._deep(call):
            return self._signs_at(call, env, np.arange(self.frames) >= since).sure
        return self._truth_of(call, env).sure

    def _truth_of(self, call: ast.Call, env: Env) -> Truth:
        """The frames of a state or relation."""
        bodies = tuple(map(env.get, call.args, call.args))
        declared, key = self.rules.states.get(call.name), ("truth", call.name, bodies)
        if self._deep(call) and ("state", call.name, bodies) not in self._answers:
            return truth_of(self.signs(call.name, bodies))
        return self.once(declared, key, self._told_by, call, env)

    def _told_by(self, call: ast.Call, env: Env) -> Truth:
        return truth_of(self.state(call, env))

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
        truth = self._truth_of(event.call, env)
        return moment.ends(truth) if event.edge == "end" else moment.starts(truth)
