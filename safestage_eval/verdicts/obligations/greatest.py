"""The greatest margin of a costly condition, measured at as few frames as that takes.

What is cheap bounds the margin at every frame. Only where it may exceed the greatest that is known
already, what is costly is asked for: first where it may exceed it most.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import ClauseKind
from safestage_eval.states.band import Band, Bool
from safestage_eval.states.scope import Scope
from safestage_eval.verdicts.costly import is_for_good
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.values import Env

FIRST, MORE = 4, 8
"""At so many frames at first, and at so many times as many whenever these do not decide."""


class Greatest(NamedTuple):
    """Bounds of the greatest margin in a scope, and the first frame (from its start) that has it."""

    surely: float
    possibly: float
    frame: int


def greatest(evaluator: Evaluator, what: ast.Alternative, env: Env, scope: Scope) -> Greatest:
    """The greatest margin of a costly condition in a scope of at least one frame.

    Where only signs matter, a margin of the same sign.
    """
    first, stop, at = scope.first, scope.stop, np.arange(scope.stop - scope.first)
    low, high = np.full(len(at), -np.inf), np.full(len(at), -np.inf)
    for find in _parts(evaluator, what, env, scope):
        measured, many = np.zeros(evaluator.frames, np.bool_), FIRST
        while True:
            band = find(measured).at(first, stop)
            lower = np.maximum(low, np.where(scope.certain, band.lower, -np.inf))
            best = int(lower.argmax())
            open_ = (band.upper > lower[best]) | ((band.upper == lower[best]) & (at < best))
            if evaluator.signs_alone:
                open_ &= (band.upper >= 0) & (lower[best] < 0)
            open_ &= ~measured[first:stop]
            if not open_.any():
                break
            frames = open_.nonzero()[0]
            frames = frames[np.argsort(-band.upper[frames], kind="stable")]
            measured[first + frames[:many]] = True
            many *= MORE
        low, high = lower, np.maximum(high, band.upper)
    surely, possibly = float(low.max()), float(high.max())
    return Greatest(surely, possibly, int((low if surely >= 0 else high).argmax()))


def _parts(
    evaluator: Evaluator, what: ast.Alternative, env: Env, scope: Scope
) -> Iterator[Callable[[Bool], Band]]:
    """The alternatives of something forbidden, the cheapest first; each a function from frames to its band (T,).

    A state that holds for good is as near to it at its nearest as what it is made of.
    """
    for one in evaluator.costly.sorted(_alternatives(what)):
        state = None
        if isinstance(one, ast.Event) and one.call is not None and one.edge is None:
            state = evaluator.rules.states.get(one.call.name)
        if state is not None and is_for_good(state) and scope.first == 0 and scope.sure is None:
            assert isinstance(one, ast.Event) and one.call is not None
            bodies = [env.get(arg, arg) for arg in one.call.args]
            inner = dict(zip(state.of, bodies, strict=True))
            for part in evaluator.costly.sorted(_alternatives(state.when)):
                yield _finder(evaluator, None, part, inner)
        else:
            yield _finder(evaluator, "forbid", one, env)


def _finder(
    evaluator: Evaluator, kind: ClauseKind | None, what: ast.Alternative, env: Env
) -> Callable[[Bool], Band]:
    return lambda frames: evaluator.obliged(kind, evaluator.alternative, what, env, frames)


def _alternatives(what: ast.Alternative) -> tuple[ast.Alternative, ...]:
    if isinstance(what, ast.Condition) and len(what.atoms) == 1:
        atom = what.atoms[0]
        if isinstance(atom, ast.AnyOf):
            return atom.alternatives
    return (what,)
