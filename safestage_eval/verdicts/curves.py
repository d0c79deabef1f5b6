"""The measurements that a rule compares, with their limits, and the states that it names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from safestage_eval.evidence.series import Series
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import CLAUSES
from safestage_eval.states.band import Band, Bool

from .evaluate import Evaluator
from .players import combinations
from .search import since
from .stretches import stretches
from .values import Env
from .verdict import Verdict


@dataclass(frozen=True)
class Bound:
    """One limit of a measurement.

    Attributes:
        value: SI.
        bad: the side on which the rule, as far as this limit goes, is broken.
        param: name of the parameter that holds it; None where it is written out.
    """

    value: float
    bad: Literal["above", "below"]
    param: str | None = None


@dataclass(frozen=True, eq=False)
class Curve:
    """A measurement over time, (T,) SI, with the limits that a rule sets it."""

    signal: str
    series: Series
    limits: tuple[Bound, ...]


@dataclass(frozen=True, eq=False)
class Lane:
    """A state over time: (T,) where it is true, and where that is known."""

    name: str
    true: Bool
    known: Bool


@dataclass(frozen=True, eq=False)
class Looked:
    """The evidence behind a verdict.

    Attributes:
        curves: the decisive measurement first.
        lanes: the states that the rule names, and what ends its scope.
        judged: [first, stop) frames of every stretch that was judged.
    """

    curves: tuple[Curve, ...]
    lanes: tuple[Lane, ...]
    judged: tuple[tuple[int, int], ...]


def looked_at(
    evaluator: Evaluator,
    rule: ast.Rule,
    players: dict[str, tuple[str, ...]],
    verdict: Verdict,
    wanted: Bool | None = None,
) -> Looked:
    """The measurements and states behind a verdict, for the bodies that decided it.

    Args:
        evaluator: of the episode, under the rule's parameters.
        rule: that was judged.
        players: role → the bodies that play it.
        verdict: what it came to.
        wanted: (T,) frames at which costly signals are measured, unknown elsewhere; all if None.
    """
    evaluator.players = players
    env = _env(rule, players, verdict)
    if env is None:
        return Looked((), (), ())
    curves: dict[str, Curve] = {}
    lanes: dict[str, Lane] = {}
    for atom, inner, bad_when in _atoms(evaluator, rule, env):
        if isinstance(atom, ast.Call):
            said = _said(atom, inner)
            signals = (evaluator.rules.signals, evaluator.rules.derived)
            if said not in lanes and not any(atom.name in declared for declared in signals):
                lanes[said] = _lane(said, evaluator.state(atom, inner, wanted))
            continue
        curve = _curve(evaluator, atom, inner, bad_when, wanted)
        before = curves.get(curve.signal)
        limits = (*before.limits, *curve.limits) if before is not None else curve.limits
        curves[curve.signal] = Curve(curve.signal, curve.series, tuple(dict.fromkeys(limits)))
    first = [name for name in curves if name == verdict.signal]
    return Looked(
        tuple(curves[name] for name in [*first, *(n for n in curves if n not in first)]),
        tuple(lanes.values()),
        tuple((scope.first, scope.stop) for scope, _ in stretches(evaluator, rule, env)),
    )


def _env(rule: ast.Rule, players: dict[str, tuple[str, ...]], verdict: Verdict) -> Env | None:
    """The combination of bodies that the verdict is about; the first one if it names none."""
    envs = list(combinations(rule, players))
    for env in envs:
        named = tuple(dict.fromkeys(env.values()))
        if verdict.bodies[: len(named)] == named:
            return env
    return envs[0] if envs else None


def _atoms(
    evaluator: Evaluator, rule: ast.Rule, env: Env
) -> Iterator[tuple[ast.SignalAtom | ast.Call, Env, bool]]:
    """Limits and states of a rule with the bodies they are about; and whether it is bad that they hold."""
    for clause in rule.clauses:
        yield from _inside(evaluator, clause.what, env, not CLAUSES[clause.kind].wanted, 1)
    if rule.until is not None:
        yield from _inside(evaluator, rule.until, env, False, 0)


def _inside(
    evaluator: Evaluator, what: ast.Alternative | ast.Atom, env: Env, bad_when: bool, deeper: int
) -> Iterator[tuple[ast.SignalAtom | ast.Call, Env, bool]]:
    """``deeper``: through so many declared states."""
    if isinstance(what, ast.SignalAtom):
        yield what, env, bad_when
    elif isinstance(what, ast.Condition):
        for atom in what.atoms:
            yield from _inside(evaluator, atom, env, bad_when, deeper)
    elif isinstance(what, ast.AnyOf):
        for alternative in what.alternatives:
            yield from _inside(evaluator, alternative, env, bad_when, deeper)
    elif isinstance(what, ast.CountAtom):
        turned = bad_when if what.bound == "least" else not bad_when
        for body in evaluator.players.get(what.role, ()):
            inner = {**env, what.role: body}
            yield from _called(evaluator, what.call, inner, turned, deeper)
    elif what.call is not None:
        turned = bad_when == getattr(what, "want", True)
        other = getattr(what, "begun", None) or getattr(what, "other", None)
        if other is not None:
            yield from _called(evaluator, other, env, turned, deeper)
        yield from _called(evaluator, what.call, env, turned, deeper)


def _called(
    evaluator: Evaluator, call: ast.Call, env: Env, bad_when: bool, deeper: int
) -> Iterator[tuple[ast.SignalAtom | ast.Call, Env, bool]]:
    yield call, env, bad_when
    declared = evaluator.rules.states.get(call.name)
    if declared is None or not deeper:
        return
    inner = dict(zip(declared.of, (env.get(arg, arg) for arg in call.args), strict=True))
    blind = declared.fallback is not None and evaluator.relations.blind
    for source in (declared.fallback, declared.perhaps) if blind else (declared.when,):
        for item in _inside(evaluator, source, inner, bad_when, deeper - 1) if source else ():
            if isinstance(item[0], ast.SignalAtom):
                yield item


def _curve(
    evaluator: Evaluator, atom: ast.SignalAtom, env: Env, bad_when: bool, wanted: Bool | None
) -> Curve:
    bounds = []
    for limit in atom.limits:
        side: Literal["above", "below"] = "above" if (limit.op[0] == ">") == bad_when else "below"
        param = limit.value.name if isinstance(limit.value, ast.Parameter) else None
        bounds.append(Bound(evaluator.number(limit.value, env), side, param))
    series = evaluator.series(atom, env, wanted)
    return Curve(_said(atom.call, env) + since(atom, env), series, tuple(bounds))


def _said(call: ast.Call, env: Env) -> str:
    """The call with the bodies' names, as witnesses write it."""
    return str(ast.Call(call.name, tuple(env.get(arg, arg) for arg in call.args)))


def _lane(name: str, state: Band) -> Lane:
    return Lane(name, state.true, ~state.unknown)


def frames_to_measure(frames: int, also: Sequence[int] = (), most: int = 240) -> Bool:
    """(T,) evenly spaced frames, at most so many, and those that must be among them."""
    wanted = np.zeros(frames, np.bool_)
    wanted[np.unique(np.linspace(0, frames - 1, min(most, frames)).astype(int))] = True
    wanted[[frame for frame in also if 0 <= frame < frames]] = True
    return wanted
