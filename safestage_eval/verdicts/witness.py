"""What decided a verdict: a measurement, found by walking down the evaluated tree, or what broke the rule first.

And is a minimum, or a maximum, persistence a minimum or maximum over nearby frames: all of them only
select, so that the part whose margin was selected is found again, bit for bit. Of parts whose margins are
alike the first one in the rule's order is taken, or rounding would choose between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from safestage_eval.episode.runs import runs
from safestage_eval.evidence.declare import is_gate
from safestage_eval.evidence.intervals import Interval
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import CLAUSES
from safestage_eval.signals import SIGNALS

from . import between_samples
from . import since as changes
from .evaluate import Evaluated, Evaluator
from .language import Env, limit_margin
from .obligations import Instance
from .windows import without_short_runs

ALIKE = 1e-4
"""Normalised margins that differ by this share are alike: poses are stored as float32, and an ulp of
6e-8 m within the 0.1 s of a mean speed is 6e-5 of a limit of 1 cm/s."""

_OPPOSITE = {">=": "<", "<=": ">", ">": "<=", "<": ">="}


class Witness(NamedTuple):
    """The decisive atom at its decisive frame.

    Attributes:
        signal: the atom with the bodies' names, ``clearance(dumbbell, glasses)``.
        bodies: those names.
        frame: where its value was taken.
        value, limit: SI; None for a relation, which has no size.
        margin: SI, distance of the value from the limit, negative when violated.
        dimension: of value, limit and margin.
        name: of the signal alone, ``clearance``; None for a relation.
        tied: another atom has the very same margin there, so that naming this one is arbitrary.
        at_least: the value is only known to be no less (a clearance beyond what had to be known).
        state: the state that decided, where it has a sentence of its own.
        bearers: what bears the body, where the signal measures against that; in its sentence.
        needs: on which side of the limit the value must lie, as ``>=``; of a relation ``true`` or
            ``false``. Empty where neither is asked.
    """

    signal: str
    bodies: tuple[str, ...]
    frame: int
    value: float | None = None
    limit: float | None = None
    margin: float | None = None
    dimension: str | None = None
    name: str | None = None
    at_least: bool = False
    tied: bool = False
    state: ast.Call | None = None
    needs: str = ""
    bearers: tuple[str, ...] = ()

    @property
    def said(self) -> str:
        """The signal as a sentence names it: ``edge_margin(cup) on shelf``."""
        return f"{self.signal} on {' and '.join(self.bearers)}" if self.bearers else self.signal

    def or_tied(self, margins: Sequence[float], decisive: float) -> Witness:
        """The witness, marked where several margins are the decisive one."""
        alike = sum(margin == decisive for margin in margins)
        return self._replace(tied=True) if alike > 1 else self


def witness_of(evaluator: Evaluator, instance: Instance, *, violated: bool) -> Witness:
    """The measurement behind the margin of an instance that has a decisive obligation."""
    assert instance.clause is not None
    return witness_at(evaluator, instance.clause, instance.tree, instance.frame, violated=violated)


def witness_at(
    evaluator: Evaluator, clause: ast.Clause, tree: Evaluated, frame: int, *, violated: bool
) -> Witness:
    """The measurement behind the margin of (a part of) an obligation at a frame."""
    holds = CLAUSES[clause.kind].wanted
    return _Walk(evaluator, violated == holds, 1 if holds else -1).down(tree, frame)


def undersampled(evaluator: Evaluator, witness: Witness) -> float | None:
    """M by which the value may differ between two frames, if the limit lies within that."""
    if witness.name is None or witness.value is None or witness.limit is None or witness.at_least:
        return None
    slack = between_samples.further(evaluator, witness.name, witness.bodies, witness.frame)
    if slack is None or abs(witness.value - witness.limit) > slack:
        return None
    return slack


def as_sampled(evaluator: Evaluator, instance: Instance) -> Instance:
    """An instance that is met at every sample, but may not be between two that are far apart."""
    frame = instance.frame
    if instance.lower < 0 or instance.clause is None or instance.scope.stop <= frame:
        return instance
    if not evaluator.clock.coarse[max(frame - 1, 0) : frame + 1].any():
        return instance
    witness = witness_of(evaluator, instance, violated=False)
    slack = undersampled(evaluator, witness)
    if slack is None or witness.value is None or witness.limit is None:
        return instance
    apart = abs(witness.value - witness.limit)
    return instance._replace(lower=between_samples.lowest(instance.lower, apart, slack))


class _Walk(NamedTuple):
    """Follows one end of a margin down to the atom that it was selected from.

    Attributes:
        evaluator: that computed it.
        upper: which end is followed.
        sign: +1 where the atom should hold, -1 where it should not.
    """

    evaluator: Evaluator
    upper: bool
    sign: int = 1

    def end(self, margin: Interval, frame: int) -> float:
        return float((margin.upper if self.upper else margin.lower)[frame])

    @property
    def asks(self) -> str:
        """``Witness.needs`` of a relation."""
        return "true" if self.sign > 0 else "false"

    def opposite(self) -> _Walk:
        return _Walk(self.evaluator, not self.upper, -self.sign)

    def unmeasured(self, what: str, bodies: Sequence[str], frame: int) -> Witness:
        return Witness(what, tuple(bodies), frame, needs=self.asks)

    def down(self, tree: Evaluated, frame: int) -> Witness:
        """The witness of a part at a frame."""
        node = tree.node
        match node:
            case ast.Condition():
                if len(tree.children) == 1:
                    return self.down(tree.children[0], frame)
                margins = self._all(tree, frame)
                witness = self.down(tree.children[_least(margins)], frame)
                return witness.or_tied(margins, min(margins))
            case ast.AnyOf():
                margins = [self.end(child.margin, frame) for child in tree.children]
                witness = self.down(tree.children[_least([-m for m in margins])], frame)
                return witness.or_tied(margins, max(margins))
            case ast.Event(call=None):
                return self.unmeasured(node.kind, (), frame)
            case ast.Event(edge=None):
                return self.down(tree.children[0], frame)
            case ast.Event():
                call = tree.children[0].node
                assert isinstance(call, ast.Call)  # of a state
                return self.unmeasured(f"{node.edge} of {call}", call.args, frame)
            case ast.StateAtom():
                return (self if node.want else self.opposite()).down(tree.children[0], frame)
            case ast.CountAtom():
                return self._count(node, tree, frame)
            case ast.SignalAtom():
                return self._signal(node, tree, frame)
        return self._state(tree, frame)

    def _all(self, tree: Evaluated, frame: int) -> list[float]:
        """The end that is followed, of each atom; a gate counts only where the rest holds."""
        margins = [self.end(child.margin, frame) for child in tree.children]
        gates = [
            isinstance(child.node, ast.StateAtom) and is_gate(child.node.call.name)
            for child in tree.children
        ]
        if all(gates) or not any(gates):
            return margins
        rest = min(m for m, gate in zip(margins, gates, strict=True) if not gate)
        return [np.inf if gate and rest < 0 else m for m, gate in zip(margins, gates, strict=True)]

    def _count(self, node: ast.CountAtom, tree: Evaluated, frame: int) -> Witness:
        walk = self if node.bound == "least" else self.opposite()
        count = node.count if node.bound == "least" else node.count + 1
        if not 1 <= count <= len(tree.children):
            bodies = self.evaluator.players.get(node.role, ())
            return walk.unmeasured(str(node.call), bodies, frame)
        margins = [walk.end(child.margin, frame) for child in tree.children]
        return walk.down(tree.children[int(np.argsort(margins)[-count])], frame)

    def _state(self, tree: Evaluated, frame: int) -> Witness:
        """Of a declared state, what it was made of, at the nearest frame that has its margin."""
        call = tree.node
        assert isinstance(call, ast.Call)
        if not tree.children:
            return self.unmeasured(str(call), call.args, frame)
        margin = self.end(tree.margin, frame)
        source = tree.children[0]
        if len(tree.children) > 1 and self.upper and tree.children[1].node != ast.AnyOf(()):
            source = tree.children[1]  # by geometry it may hold
        same = ((source.margin.upper if self.upper else source.margin.lower) == margin).nonzero()[0]
        brief = tree.children[-1]
        if (
            not len(same)
            and brief.node == ast.AnyOf(())
            and self.end(brief.margin, frame) == margin
        ):
            return self.down(brief, frame)
        if len(same):
            frame = int(same[np.argmin(np.abs(same - frame))])
        return self.down(source, frame)

    def _signal(self, atom: ast.SignalAtom, tree: Evaluated, frame: int) -> Witness:
        evaluator, env = self.evaluator, tree.env
        assert tree.series is not None
        series = tree.series.at(frame)
        name, bodies, _, limits, _ = evaluator.asked(atom, env)
        margins = [
            self.end(limit_margin(series, limit.op, number, 1.0), 0)
            for limit, number in zip(atom.limits, limits, strict=True)
        ]
        i = int(np.argmin(margins)) if len(margins) > 1 else 0
        said = tuple([env.get(arg, arg) for arg in atom.call.args])
        value, limit = float(series.value[0]), float(limits[i])
        op = atom.limits[i].op
        direction = 1 if op[0] == ">" else -1
        finite = bool(np.isfinite(value))
        from_ = "" if self._not_yet(atom, env, frame) else since(atom, env)
        return Witness(
            f"{ast.Call(atom.call.name, said)}{from_}",
            bodies,
            frame,
            value if finite else None,
            limit,
            self.sign * direction * (value - limit) if finite else None,
            series.dimension,
            name,
            at_least=finite and bool(np.isposinf(series.upper[0])),
            needs=op if self.sign > 0 else _OPPOSITE[op],
            bearers=self._bearers(name, bodies, frame),
        )

    def _bearers(self, name: str, bodies: tuple[str, ...], frame: int) -> tuple[str, ...]:
        """Support of a body at a frame, for signals that measure against their support by default."""
        spec, relations = SIGNALS.get(name), self.evaluator.relations
        if spec is None or not spec.support or len(bodies) != 1 or len(spec.args) != 2:
            return ()
        return relations.bearers(bodies[0], frame)

    def _not_yet(self, atom: ast.SignalAtom, env: Env, frame: int) -> bool:
        """The robot has had nothing to do with the body: it is measured from the baseline."""
        if atom.since is None or not between_samples.falls_between(atom.since):
            return False
        frames = changes.reference_of(self.evaluator, atom.since, env)[0].since
        return frames is not None and bool(frames[frame] < 0)


def since(atom: ast.SignalAtom, env: Env) -> str:
    """`` since end of handled(can)``: what a change is measured from; empty for the baseline."""
    event = atom.since
    if event is None or event.call is None:
        return f" since {event.text}" if event is not None and event.text else ""
    bodies = tuple([env.get(arg, arg) for arg in event.call.args])
    edge = "" if event.edge is None else f"{event.edge} of "
    return f" since {edge}{ast.Call(event.call.name, bodies)}"


def _bodies(tree: Evaluated) -> tuple[str, ...]:
    call = tree.children[0].node
    assert isinstance(call, ast.Call)
    return call.args


def _least(margins: list[float]) -> int:
    """Which margin is the least: the first of those alike."""
    least = min(margins)
    if np.isfinite(least):
        least += ALIKE * abs(least)
    return int(np.argmax(np.array(margins) <= least))


# ---- what came first


class Broken(NamedTuple):
    """One of the things that a rule forbids, and the first frame of its scope at which it is so."""

    frame: int
    what: ast.Alternative
    tree: Evaluated


def first_witness(
    evaluator: Evaluator, rule: ast.Rule, instance: Instance, *, violated: bool
) -> Witness | None:
    """The order of two moments, or what broke the rule first, where these count before any measurement."""
    if not rule.forbid:
        return None
    first, state = None, None
    if violated and in_turn(evaluator, rule):
        first = first_broken(evaluator, rule, instance)
    if first is not None and isinstance(first.what, ast.Event) and first.what.call is not None:
        state = speaking(evaluator, first.what.call, instance.env)
    if is_ordering(rule):
        witness = ordering(evaluator, rule, instance, first)
        if witness is not None:
            return witness._replace(state=state)
    if first is None:
        return None
    if state is not None:
        return Witness(str(state), state.args, first.frame, state=state)
    clause = instance.clause
    if clause is None or clause.kind != "forbid":
        return None
    return witness_at(evaluator, clause, first.tree, first.frame, violated=violated)


class Guarded(NamedTuple):
    """``{ any = [event], "state(…)" = false }``: the event must not come while the state is false."""

    event: ast.Event
    state: ast.Call


def is_ordering(rule: ast.Rule) -> bool:
    """It only forbids, and something before something else: before its ``until``, or unguarded."""
    if not rule.forbid or rule.require is not None or rule.reach is not None:
        return False
    return rule.until is not None or any(_guarded(what) is not None for what in rule.forbid)


def in_turn(evaluator: Evaluator, rule: ast.Rule) -> bool:
    """The first breach is the witness, not the worst: the order counts, or a state explains itself."""
    return is_ordering(rule) or any(
        isinstance(what, ast.Event) and what.call is not None and _can_speak(evaluator, what.call)
        for what in rule.forbid
    )


def _can_speak(evaluator: Evaluator, call: ast.Call) -> bool:
    state = evaluator.rules.states.get(call.name)
    if state is None:
        return False
    parts = [
        a for atom in state.when.atoms if isinstance(atom, ast.AnyOf) for a in atom.alternatives
    ]
    calls = [a.call for a in parts if isinstance(a, ast.Event) and a.call is not None]
    return bool(state.explain) or any(_can_speak(evaluator, part) for part in calls)


def first_broken(
    evaluator: Evaluator, rule: ast.Rule, instance: Instance, *, beyond: bool = False
) -> Broken | None:
    """The forbidden thing that certainly holds first; of several at once the first written.

    ``beyond``: look past the end of the scope as well.
    """
    lasting = evaluator.window(rule.for_)
    first, stop = instance.scope.first, instance.scope.stop
    here = np.arange(evaluator.frames) >= first
    if not beyond:
        here[stop:] = False
    breaches = []
    for what in rule.forbid:
        tree = evaluator.evaluate(what, instance.env, "forbid", here)
        held = without_short_runs(tree.margin.lower, lasting)
        true = held[first : None if beyond else stop] >= 0
        if true.any():
            breaches.append(Broken(first + int(true.argmax()), what, tree))
    return min(breaches, key=lambda broken: broken.frame, default=None)


def ordering(
    evaluator: Evaluator, rule: ast.Rule, instance: Instance, first: Broken | None
) -> Witness | None:
    """The order of two moments as the time between them: t_this - t_that, negative if violated.

    "This" is the event that must not come; "that" is when the state that it must wait for began to
    hold, or would have, and without such a state the rule's ``until``. Either moment may never come;
    then the margin has no size and is left open. None where what decides is no event.

    Args:
        evaluator: of the episode.
        rule: of which ``is_ordering`` holds.
        instance: judged already.
        first: what broke it.
    """
    guards = [guard for what in rule.forbid if (guard := _guarded(what)) is not None]
    if guards:
        if instance.undecided:
            return None
        return _waited(evaluator, instance, first, guards[0])
    first = first or first_broken(evaluator, rule, instance, beyond=True)
    what = rule.forbid[0] if first is None else first.what
    if not isinstance(what, ast.Event) or what.call is None:
        return None
    that = None if instance.resolved is None else instance.resolved
    this = None if first is None else first.frame
    return _between(evaluator, instance, what.call, this, that)


def _waited(
    evaluator: Evaluator, instance: Instance, first: Broken | None, guard: Guarded
) -> Witness | None:
    env, call = instance.env, guard.event.call
    if first is not None and isinstance(first.what, ast.Event):
        call = first.what.call
    elif first is not None and _guarded(first.what) is None:
        return None
    assert call is not None
    this = None if first is None else first.frame
    if first is None:
        came = evaluator.truth(guard.event, env).true.nonzero()[0]
        this = int(came[0]) if len(came) else None
    held = evaluator.holds(guard.state, env)
    that = next((begin for begin, end in runs(held).tolist() if end > (this or 0)), None)
    return _between(evaluator, instance, call, this, that)


def _between(
    evaluator: Evaluator, instance: Instance, call: ast.Call, this: int | None, that: int | None
) -> Witness:
    t, env = evaluator.episode.t, instance.env
    bodies = tuple(env.get(arg, arg) for arg in call.args)
    came = None if this is None else float(t[this])
    safe = None if that is None else float(t[that])
    return Witness(
        str(ast.Call(call.name, bodies)),
        bodies,
        min(instance.scope.stop if this is None else this, evaluator.frames - 1),
        came,
        safe,
        None if came is None or safe is None else came - safe,
        "time",
    )


def _guarded(what: ast.Alternative) -> Guarded | None:
    if not isinstance(what, ast.Condition):
        return None
    events = [
        one
        for atom in what.atoms
        if isinstance(atom, ast.AnyOf) and len(atom.alternatives) == 1
        for one in atom.alternatives
        if isinstance(one, ast.Event) and one.call is not None and one.edge is not None
    ]
    states = [a.call for a in what.atoms if isinstance(a, ast.StateAtom) and not a.want]
    if len(what.atoms) != 2 or len(events) != 1 or len(states) != 1:
        return None
    return Guarded(events[0], states[0])


def speaking(evaluator: Evaluator, call: ast.Call, env: Env) -> ast.Call | None:
    """The state, with the bodies' names, if it has a sentence of its own.

    Else the first to begin of the states that it is any of, if that has one; None where it has none.
    """
    state = evaluator.rules.states.get(call.name)
    if state is None:
        return None
    bodies = tuple(env.get(arg, arg) for arg in call.args)
    if state.explain:
        return ast.Call(call.name, bodies)
    inner = dict(zip(state.of, bodies, strict=True))
    if len(state.when.atoms) != 1 or not isinstance(state.when.atoms[0], ast.AnyOf):
        return None
    began = []
    for one in state.when.atoms[0].alternatives:
        if isinstance(one, ast.Event) and one.call is not None and one.edge is None:
            true = evaluator.holds(one.call, inner)
            if true.any():
                began.append((int(true.argmax()), one.call))
    if not began:
        return None
    return speaking(evaluator, min(began, key=lambda item: item[0])[1], inner)
