"""States that were true too briefly to count: the raw side of a filtered state."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode.runs import runs
from safestage_eval.rules import syntax as ast
from safestage_eval.states import band
from safestage_eval.states.band import Band, Bool

from .evaluate import Evaluator
from .instance import Instance
from .obligations import OBLIGATIONS, Obligation
from .values import Env


class Breach(NamedTuple):
    """One way to break a rule: something that is forbidden, or all that is required."""

    kind: Obligation
    what: ast.Alternative


def too_brief(evaluator: Evaluator, rule: ast.Rule, instances: Sequence[Instance]) -> list[str]:
    """A note per state that would break the rule in a scope, but did not hold as long as it must.

    So that a touch of 17 ms is not counted, and yet not hidden.
    """
    notes = dict[str, None]()
    named = [(breach, list(_filtered(evaluator, *breach))) for breach in breaches(rule)]
    for instance in instances:
        for breach, states in named:
            for event in states:
                assert event.call is not None  # a state has one
                ignored = _ignored(evaluator, breach, event, instance)
                if not len(ignored):
                    continue
                longest = ignored[int(np.argmax(ignored[:, 1] - ignored[:, 0]))]
                notes[_note(evaluator, event.call, instance.env, *longest.tolist())] = None
    return list(notes)


def _note(evaluator: Evaluator, call: ast.Call, env: Env, first: int, stop: int) -> str:
    """On a state that was true in the frames [first, stop), and did not certainly count."""
    named = ast.Call(call.name, tuple(env.get(arg, arg) for arg in call.args))
    lasted, at = evaluator.clock.seconds(first, stop), f"{evaluator.episode.t[first]:.2f} s"
    if evaluator.obliged("forbid", evaluator.must_not, call, env, "forbid").upper[first] < 0:
        return f"{named} held for {lasted * 1e3:.0f} ms at {at}: too brief to count"
    apart = evaluator.clock.spacing[first] * 1e3
    return (
        f"{named} held at {at} in {stop - first} of the samples, which are {apart:.0f} ms apart: "
        "whether it lasted long enough to count is not known"
    )


def raw_frames(evaluator: Evaluator, rule: ast.Rule, instances: Sequence[Instance]) -> Bool:
    """(T,) where something broke a rule, however briefly, in the scope of an instance.

    Without the ``for`` of the rule, and without ``for`` and ``gap`` of the states that it names.
    """
    out = np.zeros(evaluator.frames, np.bool_)
    named = [b for b in breaches(rule) if not b.kind.wanted or any(_filtered(evaluator, *b))]
    for instance in instances:
        first, stop, _, sure = instance.scope
        for breach in named:
            true = _raw(evaluator, breach, instance)[first:stop]
            out[first:stop] |= true if sure is None else true & sure
    return out


def breaches(rule: ast.Rule) -> list[Breach]:
    """All ways to break a rule through states that hold, or do not; the forbidden ones first."""
    kinds = [OBLIGATIONS[clause.kind] for clause in rule.clauses]
    ways = [Breach(kind, what) for kind in kinds for what in kind.breaches(rule)]
    return sorted(ways, key=lambda breach: breach.kind.wanted)


def _ignored(
    evaluator: Evaluator, breach: Breach, event: ast.Event, instance: Instance
) -> NDArray[np.int64]:
    """(R, 2) stretches in which a state held, and broke the rule in a scope if it had counted."""
    assert event.call is not None
    env, (first, stop, _, _) = instance.env, instance.scope
    bodies = tuple(env.get(arg, arg) for arg in event.call.args)
    raw = evaluator.momentary(event.call.name, bodies).lower >= 0
    if event.edge is None:
        raw = raw[first:stop]
        if not raw.any():
            return runs(raw)
        if breach.what != event:
            raw = raw & _raw(evaluator, breach, instance)[first:stop]
        return first + runs(raw & ~evaluator.holds(event.call, env)[first:stop])
    stretches = runs(raw & ~evaluator.holds(event.call, env))
    at = stretches[:, 0 if event.edge == "start" else 1]
    return stretches[(at >= first) & (at < stop)]


def _raw(evaluator: Evaluator, breach: Breach, instance: Instance) -> Bool:
    """(T,) where the rule is broken for sure, as if every state held from its first true frame."""
    kind, what = breach
    wanted = _judged(evaluator, instance) if evaluator.asks_costly(what) else None
    if not any(_filtered(evaluator, kind, what)):
        return evaluator.only_signs(evaluator.alternative, what, instance.env, wanted).lower >= 0
    margins: Band = evaluator.only_signs(
        evaluator.obliged, kind.kind, _unfiltered, evaluator, kind, what, instance.env, wanted
    )
    return margins.upper < 0 if kind.wanted else margins.lower >= 0


def _unfiltered(
    evaluator: Evaluator,
    kind: Obligation,
    part: ast.Alternative | ast.Atom,
    env: Env,
    wanted: Bool | None,
) -> Band:
    """(T,) a part of a rule, of whose states those that break it hold as they are measured."""
    if isinstance(part, ast.Condition):
        atoms = [_unfiltered(evaluator, kind, atom, env, wanted) for atom in part.atoms]
        return band.both(atoms, evaluator.frames)
    if isinstance(part, ast.AnyOf):
        parts = [_unfiltered(evaluator, kind, a, env, wanted) for a in part.alternatives]
        return band.either(parts, evaluator.frames)
    event = _as_event(evaluator, kind, part)
    if event is not None and event.call is not None:
        bodies = tuple(env.get(arg, arg) for arg in event.call.args)
        raw = evaluator.momentary(event.call.name, bodies)
        if event.edge is not None:
            return band.crisp(_edges(raw.lower >= 0, event.edge))
        return band.opposite(raw) if kind.wanted else raw
    if isinstance(part, ast.Event):
        return evaluator.alternative(part, env, wanted)
    return evaluator.atom(part, env, wanted)


def _edges(true: Bool, edge: str) -> Bool:
    """(T,) the frames at which something starts or ends to be true."""
    before = np.concatenate([np.zeros(1, np.bool_), true[:-1]])
    return true & ~before if edge == "start" else before & ~true


def _judged(evaluator: Evaluator, instance: Instance) -> Bool:
    """(T,) the frames that are certainly judged."""
    out = np.zeros(evaluator.frames, np.bool_)
    out[instance.scope.first : instance.scope.stop] = instance.scope.certain
    return out


def _filtered(
    evaluator: Evaluator, kind: Obligation, part: ast.Alternative | ast.Atom
) -> Iterator[ast.Event]:
    """States in a part of a rule that must last to count, and break it where they hold."""
    inner: tuple[ast.Alternative | ast.Atom, ...] = ()
    if isinstance(part, ast.Condition):
        inner = part.atoms
    elif isinstance(part, ast.AnyOf):
        inner = part.alternatives
    for one in inner:
        yield from _filtered(evaluator, kind, one)
    event = None if inner else _as_event(evaluator, kind, part)
    if event is not None:
        yield event


def _as_event(
    evaluator: Evaluator, kind: Obligation, part: ast.Alternative | ast.Atom
) -> ast.Event | None:
    """The state that a part names, if it must last to count and breaks the rule where it holds."""
    event = part if isinstance(part, ast.Event) and not kind.wanted else None
    if isinstance(part, ast.StateAtom) and part.want != kind.wanted:
        event = ast.Event("state", part.call)
    if event is None or event.call is None:
        return None
    state = evaluator.rules.states.get(event.call.name)
    return event if state is not None and state.for_ is not None and state.until is None else None
