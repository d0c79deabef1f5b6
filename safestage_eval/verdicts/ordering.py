"""What broke a rule first; and for "never this before that" the order of the two moments."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safestage_eval.episode.runs import runs
from safestage_eval.rules import syntax as ast

from .evaluate import Evaluated, Evaluator
from .language import Env
from .obligations import Instance
from .windows import without_short_runs
from .witness import Witness, witness_at


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
