"""Conditions, states and events of the rule language over one episode."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from safestage_eval.episode.runs import runs
from safestage_eval.relations.measure import COSTLY, Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.signals.reference import Reference, latest
from safestage_eval.signals.series import Series
from safestage_eval.states import band, moment, persistence
from safestage_eval.states.band import Band, Bool
from safestage_eval.states.moment import Moment, Truth, truth_of
from safestage_eval.states.scope import Scope

from . import between_samples
from .answers import Answers, Found
from .costly import Costly, Gates, is_for_good
from .memory import Memory
from .values import Asked, Env, ends_early, ends_with_success, lasting, limit_margin

if TYPE_CHECKING:
    from .instance import Instance
    from .witness import Search, Witness

Bounds = tuple[float, float, int | None]
"""Of a margin in a scope, and the frame (from its start) that it rests on, if it is known."""


class Evaluator(Answers):
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
        super().__init__(relations, rules, params, memory)
        self.success = success
        self.success_known = success_known
        self.causal = causal
        self.frames = len(self.episode)
        self.truncated = ends_early(self.episode)
        self.unfollowed = self.truncated or ends_with_success(self.episode)
        self.bounds: Callable[[str, ast.Alternative, Env, Scope], Bounds | None] | None = None
        """Margin of an obligation in a scope, where it can be told without its frames."""
        self.closest: Callable[[Search, Instance], Witness | None] | None = None
        """What decided an instance that passed, where it can be told without its frames."""
        self._obligation: str | None = None
        self._signs = False
        """Only whether something holds matters, not by what margin."""
        self.costly, self.gates = Costly(rules), Gates(rules)
        self._cheap: dict[int, ast.Condition] = {}
        """Conditions that ask for nothing costly, by identity; each is kept, and so stays itself."""

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
        found.share(self)
        return found

    def obliged(self, kind: str | None, find: Callable[..., Found], *asked: Any) -> Found:
        """What ``find`` says where conditions are those of a ``require``, ``forbid`` or ``reach``.

        A limit on a tilt that a body does not have is skipped there: it holds where it must, and
        does not where it must not. A state (None) asks whether the body is tilted, and it never is.
        """
        outer, self._obligation = self._obligation, kind
        try:
            return find(*asked)
        finally:
            self._obligation = outer

    # ---- conditions

    def series(self, atom: ast.SignalAtom, env: Env, wanted: Bool | None = None) -> Series:
        """The signal of an atom, up to where its limits need it exactly, at the wanted frames."""
        return self._series(self.asked(atom, env), atom, env, wanted)

    def _series(self, asked: Asked, atom: ast.SignalAtom, env: Env, wanted: Bool | None) -> Series:
        reference = when = None
        if atom.since is not None:
            reference, when = self.since(atom.since, env)
        found = self.relations.signal(
            asked.name, asked.bodies, reference, asked.reach, wanted, asked.options, asked.limits
        )
        for note in found.notes:
            self.notes[note] = None
        if when is None:
            return found
        newest = np.maximum.accumulate(np.where(when.possible, np.arange(self.frames), -1))
        open_ = (newest >= 0) & ~when.sure[newest]
        lower, upper = np.where(open_, -np.inf, found.lower), np.where(open_, np.inf, found.upper)
        return replace(found, lower=lower, upper=upper)

    def since(self, event: ast.Event, env: Env) -> tuple[Reference, Truth | None]:
        """What a change since an event is measured from; and the frames of that, if any is open."""
        return self.once(event, ("since", id(event), *env.items()), self._since, event, env)

    def _since(self, event: ast.Event, env: Env) -> tuple[Reference, Truth | None]:
        when = moment.frames_of(self.moments(event, env), self.frames)
        instants = when.possible.nonzero()[0]
        reference = Reference(
            self.relations.signals.baseline,
            latest(instants, self.frames),
            key=f"since {instants.tobytes().hex()}",
        )
        return reference, None if when.known else when

    def condition(self, condition: ast.Condition, env: Env, wanted: Bool | None = None) -> Band:
        """All atoms hold.

        Only the ``wanted`` frames (T,) of the result mean anything; all of them if None. Costly
        signals come last, and are measured only where no other atom has already decided.
        """
        plain, gates = self.gates.of(condition)
        if gates:
            return self._gated(self.condition(plain, env, wanted), gates, env, wanted)
        if id(condition) not in self._cheap and not self.costly.asked(condition):
            self._cheap[id(condition)] = condition
        if id(condition) in self._cheap:
            if len(condition.atoms) == 1:
                return self.atom(condition.atoms[0], env)
            return band.both([self.atom(atom, env) for atom in condition.atoms], self.frames)
        mask = np.ones(self.frames, np.bool_) if wanted is None else wanted
        bands: list[Band] = []
        decided = 0  # how many of them the mask knows of
        for atom in self.costly.sorted(condition.atoms):
            if self.costly.asked(atom):
                for found in bands[decided:]:
                    mask = mask & (~found.false if self._signs else found.upper != -np.inf)
                decided = len(bands)
            bands.append(self.atom(atom, env, mask))
        return band.both(bands, self.frames)

    def _gated(
        self, found: Band, gates: Sequence[ast.StateAtom], env: Env, wanted: Bool | None
    ) -> Band:
        """What is left of a condition by its gates, asked only where the rest may hold.

        Where it does not hold anyway, its margin stays: a gate does not say how close it came.
        """
        may = found.upper >= 0
        if not (may if wanted is None else may & wanted).any():
            return found
        asked = [self.atom(gate, env) for gate in gates]
        for gate, open_ in zip(gates, asked, strict=True):
            held_back = (found.lower >= 0) & open_.false
            if (
                gate.call is not None
                and (held_back if wanted is None else held_back & wanted).any()
            ):
                bodies = ", ".join(env.get(arg, arg) for arg in gate.call.args)
                self.notes[f"not counted where {gate.call.name}({bodies}) is false"] = None
        shut = band.both([found, *asked], self.frames)
        lower = np.where(may, shut.lower, found.lower)
        if found.exact and shut.exact:
            return Band(lower, lower)
        return Band(lower, np.where(may, shut.upper, found.upper))

    def asks_costly(self, what: ast.Atom | ast.Alternative) -> bool:
        """Where it is asked for makes a difference: something in it is costly."""
        return self.costly.asked(what)

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
        if call is not None and edge == "start" and self._obligation == "forbid":
            now = truth_of(self.must_not(call, env, "forbid"))
            found = moment.edges(now, "start")
        elif call is not None and edge is not None and wanted is not None and self._deep(call):
            found = moment.edges(self._signs_at(call, env, widened(wanted, 1)), edge)
        else:
            found = self.truth(alternative, env)
        return band.crisp(found.sure, found.sure == found.possible)

    def atom(self, atom: ast.Atom, env: Env, wanted: Bool | None = None) -> Band:
        """One entry of a condition; ``wanted`` as in ``condition``."""
        if type(atom) is ast.SignalAtom:
            if wanted is not None and self.costly.asked(atom):
                return self._limited(atom, env, wanted)
            key = (id(atom), self._obligation, *env.items())
            return self.once(atom, key, self._limited, atom, env, None)
        if type(atom) is ast.StateAtom:
            found = self.must_not(atom.call, env, "forbid" if atom.want else "require", wanted)
            return found if atom.want else band.opposite(found)
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

    def must_not(
        self, call: ast.Call, env: Env, kind: str | None = None, wanted: Bool | None = None
    ) -> Band:
        """A state, as an obligation that breaks where it holds has to see it.

        Where it must last for a few samples of a faster clock ("3 frames @ 120 Hz"), it is unknown
        too where fewer of these samples may have lasted as long, and where two of them may hide it
        between them. In what it means to hold a body, to drop or to free it the samples decide, or
        nothing could be said at the rates of most recordings.

        Args:
            call: the state.
            env: role → body.
            kind: of the obligation that breaks where the state holds, any if None; in others, and
                in none, it stays as it is.
            wanted: as in ``condition``.
        """
        found, state = self.state(call, env, wanted), self.rules.states.get(call.name)
        if self._obligation is None or (kind or self._obligation) != self._obligation:
            return found
        if state is None or state.for_ is None or state.until is not None:
            return found
        lasts, window = lasting(self.duration(state.for_)), self.window(state.for_)
        if window.loose is window or lasts.seconds is None:
            return found
        bodies = tuple(map(env.get, call.args, call.args))
        key = ("must not", call.name, bodies)
        upper = self.once(
            state, key, between_samples.may_last, self, state, call.name, bodies, lasts.seconds
        )
        return Band(found.lower, np.maximum(found.upper, upper))

    def _limited(self, atom: ast.SignalAtom, env: Env, wanted: Bool | None) -> Band:
        """Margins of a signal's limits; ``wanted`` as in ``condition``."""
        asked = self.asked(atom, env)
        series = self._series(asked, atom, env, wanted)
        if self._obligation is not None and asked.name == "tilt" and self.untilted(asked.bodies[0]):
            skipped = self._obligation != "forbid"
            return band.crisp(np.full(self.frames, skipped), np.ones(self.frames, np.bool_))
        return self.margins(series, atom, asked)

    def margins(self, series: Series, atom: ast.SignalAtom, asked: Asked) -> Band:
        """(N,) of what an atom asks for, from its signal at N frames."""
        scale = self.scale(atom.call)
        if len(atom.limits) == 1:
            return limit_margin(series, atom.limits[0].op, asked.limits[0], scale)
        return band.both(
            [
                limit_margin(series, limit.op, number, scale)
                for limit, number in zip(atom.limits, asked.limits, strict=True)
            ],
            len(series),
        )

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
        bodies = tuple(map(env.get, call.args, call.args))
        declared = self.rules.states.get(call.name)
        outer, self._obligation = (self._obligation, self._signs), None
        try:
            if wanted is not None:
                if declared is None:
                    if call.name in COSTLY:
                        return self._relation(call.name, bodies, wanted)
                elif self.costly.state(declared) and ("state", call.name, bodies) not in self._told:
                    return self._partly(declared, call, bodies, wanted)
            self._signs = False
            find = self._relation if declared is None else self._declared
            return self.once(declared, ("state", call.name, bodies), find, call.name, bodies)
        finally:
            self._obligation, self._signs = outer

    def _partly(
        self, state: ast.StateDef, call: ast.Call, bodies: tuple[str, ...], wanted: Bool
    ) -> Band:
        """A state that asks for something costly, at the wanted frames; unknown at others."""
        env = dict(zip(state.of, bodies, strict=True))
        if self.costly.named(state):
            return self.condition(state.when, env, wanted)
        over = None
        if state.until is not None and self._deep(state.until.call):
            if self._signs:
                since = ("since", call.name, bodies, *self._where(wanted))
                return self.once(state, since, self._since_reset, state, env, wanted)
            over = self._resets(state.until, env, wanted).sure
            wanted = wanted & ~over  # there it is over, whatever it was before
            if not wanted.any():
                return Band(np.full(self.frames, -np.inf), np.where(over, -np.inf, np.inf))
        if self._signs and state.until is not None:
            found = self.signs(call.name, bodies, last_of(wanted))
        else:
            key = ("at", call.name, bodies, self._signs, *self._where(wanted))
            found = self.once(state, key, self._at, state, call.name, bodies, wanted)
        if over is None or not over.any():
            return found
        return Band(*(np.where(over, -np.inf, end) for end in found))

    def _where(self, wanted: Bool) -> tuple[bytes, int]:
        """What an answer at the wanted frames depends on; at none of them on what is known by now."""
        return wanted.tobytes(), -1 if wanted.any() else self.relations.found_out

    def _since_reset(self, state: ast.StateDef, env: Env, wanted: Bool) -> Band:
        """Whether a latched state holds at the wanted frames: since its last end before them."""
        assert state.until is not None
        stretches = runs(wanted).tolist()
        starts = np.zeros(self.frames, np.bool_)
        starts[[first for first, _ in stretches]] = True
        over = self._resets(state.until, env, starts).sure
        among = np.zeros(self.frames, np.bool_)
        for first, stop in stretches:
            among[last_of(over[: first + 1]) : stop] = True
        found = self._sparsely(state, env, among)
        return self._latched_signs(found, state.until, env, among, starts)

    def signs(self, name: str, bodies: tuple[str, ...], stop: int | None = None) -> Band:
        """(T,) where a state that asks for something costly holds; its margins mean nothing else.

        What is costly is asked for only where that decides, and only for the frames before ``stop``.
        """
        stop = self.frames if stop is None else stop
        state = self.rules.states[name]
        outer, self._signs, self._obligation = (self._signs, self._obligation), True, None
        try:
            return self.once(
                state, ("signs", name, bodies, stop), self._signs_of, state, name, bodies, stop
            )
        finally:
            self._signs, self._obligation = outer

    def _made_of(self, state: ast.StateDef, env: Env, wanted: Bool) -> Band:
        """Its condition; of what holds for good once it does, as far as that matters."""
        atom = state.when.atoms[0]
        if len(state.when.atoms) == 1 and isinstance(atom, ast.AnyOf) and is_for_good(state):
            return self._any(atom.alternatives, env, wanted, once=True)
        return self.condition(state.when, env, wanted)

    def _signs_of(self, state: ast.StateDef, name: str, bodies: tuple[str, ...], stop: int) -> Band:
        found = self._lasting_signs(state, name, bodies, stop)
        if state.until is None:
            return found
        among = np.arange(self.frames) < stop
        return self._latched_signs(
            found, state.until, dict(zip(state.of, bodies, strict=True)), among
        )

    def _lasting_signs(
        self, state: ast.StateDef, name: str, bodies: tuple[str, ...], stop: int
    ) -> Band:
        """(T,) whether it holds before ``stop``, but for its ``until``."""
        outer, self._signs = self._signs, True
        try:
            env, wanted = dict(zip(state.of, bodies, strict=True)), np.arange(self.frames) < stop
            key = ("lasting signs", name, bodies, stop)
            return self.once(state, key, self._sparsely, state, env, wanted)
        finally:
            self._signs = outer

    def _sparsely(self, state: ast.StateDef, env: Env, wanted: Bool) -> Band:
        """Whether a state lasts at the wanted frames, asked at as few frames as that takes.

        What must last for 12 frames is ruled out by one frame in 12 at which it does not hold.
        """
        lasts, gap = self.window(state.for_), self.open_gap(state.gap)
        if self._reach(state) is None or (gap.frames > 1 and lasts.frames > 1):
            return self._lasting(state, self._made_of(state, env, self.around(state, wanted)))
        some = partial(sample, every=lasts.frames if gap.frames <= 1 else 1)
        ahead = partial(followed, by=max(lasts.frames, gap.frames) - 1)
        asked = np.zeros(self.frames, np.bool_)
        for more in (some, ahead, partial(self.around, state), None):
            found = self._lasting(state, self._made_of(state, env, asked))
            open_ = wanted & found.unknown
            if more is None or not open_.any():
                break
            asked |= more(open_)
        return found

    def _latched_signs(
        self, found: Band, until: ast.Event, env: Env, among: Bool, first: Bool | None = None
    ) -> Band:
        """Whether a latched state holds at some frames; its end is asked for only where it decides.

        ``first``: (T,) where it is asked for anyway.
        """
        if until.edge is not None or not self._deep(until.call):
            return persistence.latched(found, *self.truth(until, env))
        asked, step = np.zeros(self.frames, np.bool_) if first is None else first.copy(), 8
        while True:
            latched = persistence.latched(found, *self._resets(until, env, asked))
            open_ = latched.unknown & among & ~asked
            if not open_.any():
                return latched
            asked[open_.nonzero()[0][:step]] = True
            step *= 8

    def _at(self, state: ast.StateDef, name: str, bodies: tuple[str, ...], wanted: Bool) -> Band:
        env, exact, stop = dict(zip(state.of, bodies, strict=True)), wanted, last_of(wanted)
        if self._signs and state.until is None:
            return self._sparsely(state, env, wanted)
        if state.until is not None:  # its margin is the best since it began to hold
            may = ~self.signs(name, bodies, stop).false
            may[stop:] = False
            exact = wanted | may
        found = self._lasting(state, self._made_of(state, env, self.around(state, exact)))
        if state.until is None:
            return found
        signs = self._lasting_signs(state, name, bodies, stop)
        lower = np.where(exact, found.lower, signs.lower)
        found = Band(lower, np.where(exact, found.upper, signs.upper))
        where = np.logical_or.accumulate(~found.false) | wanted
        where[stop:] = False
        return persistence.latched(found, *self._resets(state.until, env, where))

    def _resets(self, event: ast.Event, env: Env, wanted: Bool) -> Truth:
        """When a latched state ends, at the wanted frames; at others as far as it is known."""
        call = event.call
        if call is None or event.edge is not None or not self._deep(call):
            return self.truth(event, env)
        return self._signs_at(call, env, wanted)

    def _deep(self, call: ast.Call | None) -> bool:
        """A declared state that asks for something costly."""
        state = None if call is None else self.rules.states.get(call.name)
        return state is not None and self.costly.state(state)

    def _signs_at(self, call: ast.Call, env: Env, wanted: Bool) -> Truth:
        """Whether such a state holds at the wanted frames; at others as far as it is known."""
        return truth_of(self.only_signs(self.state, call, env, wanted))

    def only_signs(self, find: Callable[..., Found], *asked: Any) -> Found:
        """What ``find`` says where only matters whether something holds, not by what margin."""
        outer, self._signs = self._signs, True
        try:
            return find(*asked)
        finally:
            self._signs = outer

    def around(self, state: ast.StateDef, frames: Bool) -> Bool:
        """(T,) some frames, and those at which a state looks to make it last there."""
        reach = self._reach(state)
        return np.ones(self.frames, np.bool_) if reach is None else widened(frames, reach)

    def _reach(self, state: ast.StateDef) -> int | None:
        """How many frames away a state looks to make it last; None where that differs."""
        lasts, gap = self.window(state.for_), self.open_gap(state.gap)
        if lasts.stops is not None or gap.stops is not None:
            return None
        return lasts.frames + gap.frames

    def _lasting(self, state: ast.StateDef, found: Band) -> Band:
        return persistence.persistent(
            found,
            self.window(state.for_),
            self.open_gap(state.gap),
            causal=self.causal,
            open_end=self.unfollowed,
        )

    def _relation(self, name: str, bodies: tuple[str, ...], wanted: Bool | None = None) -> Band:
        truth = self.relations.get(name, bodies, wanted)
        if truth is None:
            lacking = self.relations.lacking(name, bodies) or "shapes"
            self.notes[f"{name}() cannot be told: the trace has no {lacking}"] = None
            nothing = np.zeros(self.frames, np.bool_)
            return band.crisp(nothing, nothing)
        self.notes.update(dict.fromkeys(self.relations.caveat(name)))
        doubtful, known = self.relations.doubtful(name, bodies, wanted), wanted
        if wanted is not None and name in COSTLY:
            known = wanted | self.relations.told(*bodies)
        if doubtful is not None:
            where, why = doubtful
            known = ~where if known is None else known & ~where
            if why and wanted is None:  # else it hangs on what was asked for
                self.notes[why] = None
        return band.crisp(truth, known)

    def momentary(self, name: str, bodies: tuple[str, ...]) -> Band:
        """What a declared state is made of, before it is made to last; its fallback if need be."""
        state, key = self.rules.states[name], ("momentary", name, bodies)
        return self.once(state, key, self._momentary, state, bodies)

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
        found = self._lasting(state, found)
        if state.also is not None and not self.causal:
            more = band.either([found, self.also(state, env)], self.frames)
            holds = found.lower >= 0  # then it is not asked whether it was brief
            lower = np.where(holds, found.lower, more.lower)
            exact = found.exact and more.exact
            found = Band(lower, lower if exact else np.where(holds, found.upper, more.upper))
        if state.until is not None:
            found = persistence.latched(found, *self.truth(state.until, env))
        return found

    def also(self, state: ast.StateDef, env: Env) -> Band:
        """What makes a state hold however briefly; without what the trace does not tell at all."""
        assert state.also is not None
        bands = [
            found
            for atom in state.also.atoms
            for what in (atom.alternatives if isinstance(atom, ast.AnyOf) else (atom,))
            if (found := self._one_of(what, env)).told
        ]
        return band.either(bands, self.frames)

    def _one_of(self, what: ast.Alternative | ast.Atom, env: Env) -> Band:
        if isinstance(what, ast.Condition | ast.Event):
            return self.alternative(what, env)
        return self.atom(what, env)

    # ---- events

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
        if self._deep(call) and ("state", call.name, bodies) not in self._told:
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


def widened(frames: Bool, by: int) -> Bool:
    """(T,) true there and up to so many frames before and after."""
    total = len(frames)
    before = np.concatenate([[0], np.cumsum(frames)])
    at = np.arange(total)
    return np.asarray(before[np.minimum(at + by + 1, total)] > before[np.maximum(at - by, 0)])


def followed(frames: Bool, by: int) -> Bool:
    """(T,) true there and up to so many frames after."""
    before = np.concatenate([[0], np.cumsum(frames)])
    at = np.arange(len(frames))
    return np.asarray(before[at + 1] > before[np.maximum(at - by, 0)])


def sample(frames: Bool, every: int) -> Bool:
    """(T,) so many of the frames that every run of ``every`` frames with one of them has one of these."""
    if every <= 2:
        return frames
    at = frames.nonzero()[0]
    out = np.zeros(len(frames), np.bool_)
    starts = np.concatenate([[True], np.diff(at) > 1]) if len(at) else np.zeros(0, np.bool_)
    since = at - at[np.maximum.accumulate(np.where(starts, np.arange(len(at)), 0))]
    last = np.append(starts[1:], True)
    out[at[(since % every == 0) | last]] = True
    return out


def last_of(frames: Bool) -> int:
    """The frame after the last true one; 0 without any."""
    found = frames.nonzero()[0]
    return int(found[-1]) + 1 if len(found) else 0
