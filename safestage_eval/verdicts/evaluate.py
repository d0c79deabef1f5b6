"""The rule language over one episode: each part of a rule becomes a margin over time, kept as a tree.

Explaining a verdict later is a walk down that tree along the part that decided (``witness``, ``reasons``):
nothing is found out twice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from safestage_eval.episode import Window
from safestage_eval.evidence import intervals
from safestage_eval.evidence.declare import is_costly, is_gate
from safestage_eval.evidence.intervals import F64, Bool, Interval
from safestage_eval.relations.relations import Relations
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import CLAUSES, ClauseKind

from . import between_samples, computed_signals, events, since, windows
from .events import Moment
from .language import (
    Asked,
    Env,
    Evaluated,
    Language,
    Node,
    ends_early,
    ends_with_success,
    lacks_its_success,
    limit_margin,
)
from .ranges import ROUNDING, Range, Undecided, open_truth
from .windows import last_of, lasting, widened

__all__ = ["Evaluated", "Evaluator", "Node"]

Part = TypeVar("Part", bound=ast.Atom | ast.Alternative)


class Evaluator(Language):
    """What the parts of rules come to on one episode, under one set of parameter values.

    Attributes:
        success, success_known: frame of native success, None if it never came; and whether that is known.
        causal: states look only backwards, as in a rollout that is still running.
        truncated: the trace stops before its rollout did.
        unfollowed: what is under way at its end is not followed to its own end.
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
        memo: dict[tuple[Any, ...], Any] | None = None,
    ) -> None:
        """Prepare; nothing is computed yet.

        Args:
            relations: as in ``Language``.
            rules: likewise.
            params: likewise.
            memo: likewise.
            success: frame that confirmed native success, None if it never came.
            success_known: False where the trace does not tell; then nothing after it is known.
            causal: states look only backwards.
        """
        super().__init__(relations, rules, params, memo)
        self.frames = len(self.episode)
        self._any_coarse = bool(self.clock.coarse.any())
        self.success, self.success_known, self.causal = success, success_known, causal
        cut = success is None and not causal and lacks_its_success(self.episode)
        self.truncated = cut or ends_early(self.episode)
        self.unfollowed = self.truncated or ends_with_success(self.episode)

    def under(self, params: ast.Params) -> Evaluator:
        """Return an evaluator of the episode under other values; shares everything they cannot change."""
        return Evaluator(
            self.relations, self.rules, params, self.success,
            success_known=self.success_known, causal=self.causal, memo=self._memo,
        )  # fmt: skip

    # ---- conditions

    def evaluate(
        self,
        node: Node,
        env: Env,
        kind: ClauseKind | None = None,
        frames: Bool | None = None,
    ) -> Evaluated:
        """A part of a rule over the episode.

        Args:
            node: a condition, an event or one atom of a condition.
            env: role → body.
            kind: the obligation that it is read in, None outside of one. In an obligation a limit on a
                tilt that a body does not have is skipped: it holds where it must, and does not where it
                must not. A state asks whether the body is tilted, and it never is.
            frames: (T,) those that matter, all if None: what is costly is measured there alone, and
                unknown at others.
        """
        try:
            match node:
                case ast.Condition():
                    return self._all(node, env, kind, frames)
                case ast.AnyOf():
                    return self._any(node, env, kind, frames)
                case ast.Event():
                    return self._event(node, env, kind, frames)
                case ast.SignalAtom():
                    return self._limit(node, env, kind, frames)
                case ast.StateAtom():
                    only: ClauseKind = "forbid" if node.want else "require"
                    state = self.must_not(node.call, env, only, kind, frames)
                    margin = state.margin if node.want else intervals.opposite(state.margin)
                    return Evaluated(node, env, margin, (state,))
                case ast.CountAtom():
                    return self._count(node, env, frames)
            return self.state(node, env, frames)
        except Undecided:
            return Evaluated(node, env, open_truth(np.ones(self.frames, np.bool_)))

    def _all(
        self, node: ast.Condition, env: Env, kind: ClauseKind | None, frames: Bool | None
    ) -> Evaluated:
        """All atoms hold. What is costly is asked for last, where no other atom has ruled it out.

        A gate only says whether the rest of its condition counts: where that does not hold anyway, its
        margin stays.
        """
        gates, others = self._gates(node)
        ordered = len(node.atoms) > 1 and self._any_coarse and between_samples.asks_edge(node)
        parts: dict[int, Evaluated] = {}
        for atom, costly in others:
            if not costly:
                part = self.evaluate(atom, env, kind)
            else:
                ends = [] if ordered else [p.margin.upper for p in parts.values()]
                part = self._asked_at(
                    _left_open(ends, -np.inf, frames), frames, np.inf, atom, env, kind
                )
            if ordered and not between_samples.asks_edge(atom):
                held = between_samples.held_before_too(part.margin, self.clock.coarse)
                part = part._replace(margin=held)
            parts[id(atom)] = part
        margin = intervals.both([part.margin for part in parts.values()], self.frames)
        may = margin.upper >= 0
        counts = bool((may if frames is None else may & frames).any()) if gates else False
        for gate in gates:
            part = Evaluated(gate, env, intervals.crisp(np.ones(self.frames, np.bool_)))
            if counts:
                part = self.evaluate(gate, env, kind)
                self._note_gate(gate, env, (margin.lower >= 0) & part.margin.false, frames)
                part = part._replace(margin=_elsewhere(part.margin, may, np.inf))
            parts[id(gate)] = part
        if counts:
            margin = intervals.both(
                [margin, *(parts[id(gate)].margin for gate in gates)], self.frames
            )
        return Evaluated(node, env, margin, tuple(parts[id(atom)] for atom in node.atoms))

    def _note_gate(self, gate: ast.StateAtom, env: Env, shut: Bool, frames: Bool | None) -> None:
        if (shut if frames is None else shut & frames).any():
            bodies = ", ".join(env.get(arg, arg) for arg in gate.call.args)
            self.notes[f"not counted where {gate.call.name}({bodies}) is false"] = None

    def _any(
        self, node: ast.AnyOf, env: Env, kind: ClauseKind | None, frames: Bool | None
    ) -> Evaluated:
        """One of several holds. What is costly is asked for last, where no other one certainly does."""
        parts: dict[int, Evaluated] = {}
        for one, costly in self._by_cost(node, node.alternatives):
            if not costly:
                parts[id(one)] = self.evaluate(one, env, kind)
                continue
            asked = _left_open([p.margin.lower for p in parts.values()], np.inf, frames)
            parts[id(one)] = self._asked_at(asked, frames, -np.inf, one, env, kind)
        children = tuple(parts[id(one)] for one in node.alternatives)
        margin = intervals.either([child.margin for child in children], self.frames)
        return Evaluated(node, env, margin, children)

    def _asked_at(
        self,
        asked: Bool | None,
        frames: Bool | None,
        neutral: float,
        node: ast.Atom | ast.Alternative,
        env: Env,
        kind: ClauseKind | None,
    ) -> Evaluated:
        """A costly part at the frames at which it decides; at others that matter its margin is ``neutral``."""
        part = self.evaluate(node, env, kind, asked)
        if asked is None or asked is frames or (frames is None and asked.all()):
            return part
        return part._replace(margin=_elsewhere(part.margin, asked, neutral, frames))

    def _gates(
        self, node: ast.Condition
    ) -> tuple[list[ast.StateAtom], list[tuple[ast.Atom, bool]]]:
        """The gates among several atoms, if not all are gates; and the others by cost."""
        gates = [a for a in node.atoms if isinstance(a, ast.StateAtom) and is_gate(a.call.name)]
        if not gates or len(gates) == len(node.atoms):
            return [], self._by_cost(node, node.atoms)
        others = self._by_cost(node, node.atoms)
        return gates, [one for one in others if one[0] not in gates]

    def _by_cost(self, node: object, parts: tuple[Part, ...]) -> list[tuple[Part, bool]]:
        """The parts of a condition, and whether they are costly; those last."""

        def ordered() -> list[tuple[Part, bool]]:
            return sorted(((part, self.is_costly(part)) for part in parts), key=lambda one: one[1])

        return self.of_run("by cost", node, ordered)

    def _event(
        self, node: ast.Event, env: Env, kind: ClauseKind | None, frames: Bool | None
    ) -> Evaluated:
        """The frames of an event; of a bare state, all at which it holds."""
        call, edge = node.call, node.edge
        if call is None:
            return Evaluated(node, env, self.truth(node, env))
        if edge is None:
            state = self.must_not(call, env, "forbid", kind, frames)
            return Evaluated(node, env, state.margin, (state,))
        near = None if frames is None else widened(frames, 1)
        forbidding = kind is not None and not CLAUSES[kind].wanted
        if edge == "start" and forbidding:
            state = self.must_not(call, env, "forbid", kind, near)
        else:
            state = self.state(call, env, near)
        margin = events.edges(state.margin, edge)
        if not self.causal:
            margin = between_samples.perhaps_before(margin, self.clock.coarse)
        return Evaluated(node, env, margin, (state,))

    def _count(self, node: ast.CountAtom, env: Env, frames: Bool | None) -> Evaluated:
        """At least, or at most, so many of the bodies that play a role."""
        each = [
            self.state(node.call, {**env, node.role: body}, frames)
            for body in self.players.get(node.role, ())
        ]
        margins = [one.margin for one in each]
        if node.bound == "least":
            margin = intervals.at_least(node.count, margins, self.frames)
        else:
            margin = intervals.opposite(intervals.at_least(node.count + 1, margins, self.frames))
        return Evaluated(node, env, margin, tuple(each))

    # ---- limits on signals

    def _limit(
        self, atom: ast.SignalAtom, env: Env, kind: ClauseKind | None, frames: Bool | None
    ) -> Evaluated:
        if frames is not None and self.is_costly(atom):
            return self._limited(atom, env, kind, frames)
        key = "limit", kind, *env.items()
        return self.once(atom, key, lambda: self._limited(atom, env, kind, None))

    def _limited(
        self, atom: ast.SignalAtom, env: Env, kind: ClauseKind | None, frames: Bool | None
    ) -> Evaluated:
        asked = self.asked(atom, env)
        if atom.since is not None and self.ranged(atom):
            self._since_known(asked, atom.since, env)
        series = self.measured_series(asked, atom, env, frames)
        if kind is not None and self.exempt(asked):
            margin = intervals.crisp(np.full(self.frames, CLAUSES[kind].wanted))
        else:
            margin = self.margins(series, atom, asked)
        event = atom.since
        from_: tuple[Evaluated, ...] = ()
        if event is not None and event.call is not None:
            from_ = (self.state(event.call, env),)
        return Evaluated(atom, env, margin, from_, series=series)

    def series(self, atom: ast.SignalAtom, env: Env, frames: Bool | None = None) -> Interval:
        """(T,) the signal of an atom, up to where its limits need it exactly; ``frames`` as in ``evaluate``."""
        return self.measured_series(self.asked(atom, env), atom, env, frames)

    def measured_series(
        self, asked: Asked, atom: ast.SignalAtom, env: Env, frames: Bool | None
    ) -> Interval:
        """Like ``series``, of a given measurement."""
        series = since.measured(self, asked, atom, env, frames)
        for note in series.notes:
            self.notes[note] = None
        return series

    def _since_known(self, asked: Asked, event: ast.Event, env: Env) -> None:
        """Raise Undecided where a range changes when an event comes, or that is not known anyway."""
        if self.ranged(event) or since.reference_of(self, event, env)[1] is not None:
            _needed_exactly(asked)
            raise Undecided

    def margins(self, series: Interval, atom: ast.SignalAtom, asked: Asked) -> Interval:
        """(N,) of what an atom asks for, from its signal at N frames."""
        if self.ranges and self.signal(asked.name).capped and _needed_exactly(asked):
            series = replace(series, lower=series.lower - ROUNDING, upper=series.upper + ROUNDING)
        scale = self.scale(atom.call)
        each = [
            limit_margin(series, limit.op, number, scale)
            for limit, number in zip(atom.limits, asked.limits, strict=True)
        ]
        return intervals.both(each, len(series))

    def exempt(self, asked: Asked) -> bool:
        """The body has no such quantity: a ball has no tilt."""
        computed = self.rules.derived.get(asked.name)
        if computed is not None:
            operands = computed_signals.measurements(self, computed, asked.bodies)
            return any(map(self.exempt, operands))
        has_none = self.signal(asked.name).exempt
        body = self.episode.bodies.get(asked.bodies[0]) if asked.bodies else None
        return has_none is not None and body is not None and has_none(body)

    # ---- states

    def state(self, call: ast.Call, env: Env, frames: Bool | None = None) -> Evaluated:
        """A declared state or a built-in relation, persistent and latched as declared.

        ``frames`` as in ``evaluate``.
        """
        bodies = tuple(map(env.get, call.args, call.args))
        declared = self.rules.states.get(call.name)
        if frames is not None and not (
            is_costly(call.name) if declared is None else self.is_costly(declared)
        ):
            frames = None
        if frames is not None and declared is not None:
            frames = self._needed(declared, frames)
        key = "state", call.name, bodies, None if frames is None else frames.tobytes()
        if declared is None:
            return self.once(None, key, lambda: self._relation(call.name, bodies, frames))
        return self.once(declared, key, lambda: self._declared(declared, bodies, frames))

    def _needed(self, state: ast.StateDef, frames: Bool) -> Bool | None:
        """(T,) the frames that a state is made of at some frames; None: all."""
        if not frames.any():
            return frames
        if state.until is not None:  # it may have held since any frame before
            frames = np.arange(self.frames) < last_of(frames)
        if self.ranged((state.for_, state.gap)):
            return None
        lasts, gap = self.window(state.for_), self.open_gap(state.gap)
        reach = lasts.frames + gap.frames - 2
        if reach <= 0:
            return frames
        return widened(frames, reach) if self.clock.uniform else None

    def _relation(self, name: str, bodies: tuple[str, ...], frames: Bool | None) -> Evaluated:
        truth = self.relations.told(name, bodies, frames)
        for note in truth.notes:
            self.notes[note] = None
        margin = intervals.crisp(truth.lower > 0, truth.upper > 0)
        return Evaluated(ast.Call(name, bodies), {}, margin)

    def _declared(
        self, state: ast.StateDef, bodies: tuple[str, ...], frames: Bool | None
    ) -> Evaluated:
        env = dict(zip(state.of, bodies, strict=True))
        sources = [self.evaluate(state.when, env, None, frames)]
        raw = sources[0].margin
        if state.fallback is not None and not raw.any_known:
            sources = [self.evaluate(state.fallback, env)]
            raw = sources[0].margin
            if state.perhaps is not None:
                sources.append(self.evaluate(state.perhaps, env))
                raw = Interval(raw.lower, np.maximum(raw.upper, sources[1].margin.upper))
        margin = self._persistent(state, raw)
        if state.also is not None and not self.causal:
            brief = self._also(state.also, env)
            sources.append(brief)
            more = intervals.either([margin, brief.margin], self.frames)
            holds = margin.lower >= 0  # then it is not asked whether it was brief
            lower = np.where(holds, margin.lower, more.lower)
            exact = margin.exact and more.exact
            margin = Interval(lower, lower if exact else np.where(holds, margin.upper, more.upper))
        if state.until is not None:
            margin = windows.latched(margin, self.truth(state.until, env, frames))
        return Evaluated(ast.Call(state.name, bodies), env, margin, tuple(sources), raw)

    def _also(self, also: ast.Condition, env: Env) -> Evaluated:
        """What a state holds by, however briefly; parts that the trace knows nothing of are left out."""
        parts = [
            found
            for atom in also.atoms
            for what in (atom.alternatives if isinstance(atom, ast.AnyOf) else (atom,))
            if (found := self.evaluate(what, env)).margin.any_known
        ]
        margin = intervals.either([part.margin for part in parts], self.frames)
        return Evaluated(ast.AnyOf(()), env, margin, tuple(parts))

    def _persistent(self, state: ast.StateDef, raw: Interval) -> Interval:
        """Where the state lasts for long enough; unknown where too few samples, far apart, show it."""
        if state.for_ is None and state.gap is None:
            return raw
        try:
            return between_samples.lasts(self, state, lambda *how: self._lasting(raw, *how))
        except Undecided:
            possible = raw.possible  # a gap may be bridged anywhere
            if state.gap is not None:
                possible = np.full(self.frames, possible.any())
            return open_truth(possible)

    def _lasting(self, raw: Interval, state: ast.StateDef, window: Window) -> Interval:
        gap = self.open_gap(state.gap)
        return windows.persistent(raw, window, gap, causal=self.causal, open_end=self.unfollowed)

    def must_not(
        self,
        call: ast.Call,
        env: Env,
        only: ClauseKind | None,
        kind: ClauseKind | None,
        frames: Bool | None = None,
    ) -> Evaluated:
        """A state, as an obligation that breaks where it holds has to see it.

        Where it must last for a few samples of a faster clock ("3 frames @ 120 Hz"), it is unknown
        too where fewer of these samples may have lasted as long, and where two of them may hide it
        between them. In what it means to hold a body, to drop or to free it the samples decide, or
        nothing could be said at the rates of most recordings.

        Args:
            call: the state.
            env: role → body.
            only: in obligations that break as this kind does, in any if None; elsewhere the state stays
                as it is.
            kind: the obligation that it stands in, None outside of one.
            frames: as in ``evaluate``.
        """
        found, state = self.state(call, env, frames), self.rules.states.get(call.name)
        if kind is None or state is None or state.for_ is None or state.until is not None:
            return found
        if self.ranged(state.for_):  # what lasts for however long is possible there already
            return found
        if only is not None and CLAUSES[only].breaks != CLAUSES[kind].breaks:
            return found
        lasts, window = lasting(self.duration(state.for_)), self.window(state.for_)
        if window.loose is window or lasts.seconds is None or found.raw is None:
            return found
        bodies, seconds = tuple(map(env.get, call.args, call.args)), lasts.seconds
        key = "must not", call.name, bodies
        upper = self.once(state, key, lambda: self._may_last(state, bodies, seconds))
        margin = Interval(found.margin.lower, np.maximum(found.margin.upper, upper))
        return found._replace(margin=margin)

    def _may_last(self, state: ast.StateDef, bodies: tuple[str, ...], seconds: float) -> F64:
        """(T,) upper margin of a state that lasts at least as long as its samples may have."""
        raw = self.state(ast.Call(state.name, bodies), {}).raw
        assert raw is not None  # a declared state
        loose = self._lasting(raw, state, self.window(state.for_).loose).upper
        if self.clock.longest < seconds * (1 - 1e-6):
            return loose
        hidden = between_samples.hidden_touch(self, state, bodies, seconds)
        return loose if hidden is None else np.where(hidden, np.inf, loose)

    # ---- events

    @property
    def success_at_sample(self) -> bool:
        """Success came when a sample was taken, as its recorded time says."""
        stated = self.episode.header.success_time
        if stated is None or self.success is None or self.success >= self.frames:
            return False
        return abs(float(self.episode.t[self.success]) - stated) < 1e-6

    def truth(self, event: ast.Event, env: Env, frames: Bool | None = None) -> Interval:
        """The frames of an event; of a bare state, all frames where it holds.

        ``end`` comes after the last frame and so has none. ``frames`` as in ``evaluate``.
        """
        if event.kind == "state" and event.call is not None:
            near = frames if frames is None or event.edge is None else widened(frames, 1)
            now = self.state(event.call, env, near).margin
            return now if event.edge is None else events.edges(now, event.edge)
        at = np.zeros(self.frames, np.bool_)
        if event.kind == "start":
            at[:1] = True
        elif event.kind == "success" and not self.success_known:
            return intervals.crisp(at, ~at)
        elif event.kind == "success" and self.success is not None:
            at[self.success] = True
        return intervals.crisp(at)

    def holds(self, call: ast.Call, env: Env) -> Bool:
        """(T,) where a state or relation certainly holds."""
        return self.state(call, env).margin.true

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
        held = self.state(event.call, env).margin
        return events.ends(held) if event.edge == "end" else events.starts(held)


def _needed_exactly(asked: Asked) -> bool:
    """Note that ranges among the limits stand for more than limits; whether there are any."""
    over = [limit for limit in asked.limits if isinstance(limit, Range)]
    for limit in over:
        limit.seen.exactly = True
    return bool(over)


def _left_open(ends: Sequence[F64], decided: float, frames: Bool | None) -> Bool | None:
    """(T,) the frames that matter at which none of some ends has ``decided`` already; None: all."""
    open_ = frames
    for end in ends:
        undecided = end != decided
        open_ = undecided if open_ is None else open_ & undecided
    return open_


def _elsewhere(
    margin: Interval, asked: Bool, neutral: float, frames: Bool | None = None
) -> Interval:
    """The margin at the frames that were asked for; at others that matter it is ``neutral``, else unknown."""
    low = high = neutral
    lower = np.where(asked, margin.lower, low)
    upper = np.where(asked, margin.upper, high)
    if frames is not None and not frames.all():
        lower[~frames], upper[~frames] = -np.inf, np.inf
    return Interval(lower, upper)
