"""Events between samples that are far apart: whether something else came before them is not known.

``coarse`` (T,): much may happen up to the next sample.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safestage_eval.rules import syntax as ast
from safestage_eval.states.band import Band, Bool
from safestage_eval.states.scope import Scope


def asks_edge(node: ast.Alternative | ast.Atom) -> bool:
    """Something asks when a state starts or ends."""
    if isinstance(node, ast.Event):
        return node.edge is not None
    parts = node.atoms if isinstance(node, ast.Condition) else ()
    if isinstance(node, ast.AnyOf):
        return any(map(asks_edge, node.alternatives))
    return any(map(asks_edge, parts))


def depends_on_order(condition: ast.Condition, coarse: Bool) -> bool:
    """Something holds, or not, when something else starts or ends between such samples."""
    return len(condition.atoms) > 1 and bool(coarse.any()) and asks_edge(condition)


def in_any_order(condition: ast.Condition, bands: Sequence[Band], coarse: Bool) -> list[Band]:
    """The atoms' margins; what holds when an event comes must hold at the sample before as well."""
    return [
        band if asks_edge(atom) else _held_before_too(band, coarse)
        for atom, band in zip(condition.atoms, bands, strict=True)
    ]


def begun_between(what: ast.Alternative, scope: Scope, coarse: Bool) -> Scope:
    """The scope; its first frame may show an event that came before the scope began."""
    first = scope.first
    if not 0 < first < scope.stop or not coarse[first - 1] or not asks_edge(what):
        return scope
    sure = scope.certain.copy()
    sure[0] = False
    return scope._replace(sure=sure)


def _held_before_too(band: Band, coarse: Bool) -> Band:
    lower = band.lower.copy()
    before = np.minimum(lower[1:], band.lower[:-1])
    lower[1:] = np.where(coarse[:-1], before, lower[1:])
    return Band(lower, band.upper)
