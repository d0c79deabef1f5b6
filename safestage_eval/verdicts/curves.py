"""The measurements that a rule compares, with their limits, and the states that it names."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from safestage_eval.evidence.intervals import Bool, Interval
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import CLAUSES

from .evaluate import Evaluated, Evaluator
from .language import Env
from .players import combinations
from .scopes import stretches
from .verdict import Verdict
from .witness import since


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
    series: Interval
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
    for tree, bad_when in _parts(evaluator, rule, env, wanted):
        if isinstance(tree.node, ast.Call):
            lanes.setdefault(str(tree.node), _lane(str(tree.node), tree.margin))
            continue
        curve = _curve(evaluator, tree, bad_when)
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


def _parts(
    evaluator: Evaluator, rule: ast.Rule, env: Env, wanted: Bool | None
) -> Iterator[tuple[Evaluated, bool]]:
    """Limits and states of a rule; and whether it is bad that they hold."""
    for clause in rule.clauses:
        tree = evaluator.evaluate(clause.what, env, None, wanted)
        yield from _inside(tree, not CLAUSES[clause.kind].wanted, 1)
    if rule.until is not None:
        yield from _inside(evaluator.evaluate(rule.until, env, None, wanted), False, 0)


def _inside(tree: Evaluated, bad_when: bool, deeper: int) -> Iterator[tuple[Evaluated, bool]]:
    """``deeper``: through so many declared states, of which only the limits are told."""
    node = tree.node
    if isinstance(node, ast.SignalAtom):
        yield tree, bad_when
        return
    if isinstance(node, ast.Call):
        yield tree, bad_when
        if deeper:
            for child in tree.children:
                for part in _inside(child, bad_when, deeper - 1):
                    if isinstance(part[0].node, ast.SignalAtom):
                        yield part
        return
    if isinstance(node, ast.CountAtom):
        bad_when = bad_when if node.bound == "least" else not bad_when
    elif isinstance(node, ast.StateAtom):
        bad_when = bad_when == node.want
    for child in tree.children:
        yield from _inside(child, bad_when, deeper)


def _curve(evaluator: Evaluator, tree: Evaluated, bad_when: bool) -> Curve:
    atom, env, bounds = tree.node, tree.env, []
    assert isinstance(atom, ast.SignalAtom)
    assert tree.series is not None
    for limit in atom.limits:
        side: Literal["above", "below"] = "above" if (limit.op[0] == ">") == bad_when else "below"
        param = limit.value.name if isinstance(limit.value, ast.Parameter) else None
        bounds.append(Bound(evaluator.number(limit.value, env), side, param))
    said = ast.Call(atom.call.name, tuple(env.get(arg, arg) for arg in atom.call.args))
    return Curve(f"{said}{since(atom, env)}", tree.series, tuple(bounds))


def _lane(name: str, state: Interval) -> Lane:
    return Lane(name, state.true, ~state.unknown)


def frames_to_measure(frames: int, also: Sequence[int] = (), most: int = 240) -> Bool:
    """(T,) evenly spaced frames, at most so many, and those that must be among them."""
    wanted = np.zeros(frames, np.bool_)
    wanted[np.unique(np.linspace(0, frames - 1, min(most, frames)).astype(int))] = True
    wanted[[frame for frame in also if 0 <= frame < frames]] = True
    return wanted
