"""Obligations of a rule, as keys: broken, and not certainly kept, at a value and up to where.

The margin of an obligation selects among the margins of its frames, or negates them; so the obligations
of ``verdicts.obligations`` take keys as they take margins.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safestage_eval.episode import Window
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import CLAUSES, ClauseKind
from safestage_eval.states.band import Band
from safestage_eval.states.scope import Scope, mask_of
from safestage_eval.verdicts.initial_state import initial_state
from safestage_eval.verdicts.obligations import OBLIGATIONS
from safestage_eval.verdicts.values import Env

from .flip_bands import FlipBands
from .flip_lasting import Undecided, lasting_keys
from .flip_scopes import Frames

Broken = tuple[float, float]
"""Keys of an obligation being certainly broken, and of its not being certainly kept."""


def given_keys(flips: FlipBands, given: ast.Condition, env: Env) -> tuple[float, float]:
    """Keys of a condition holding in most of the baseline frames: certainly, and possibly."""
    initial = initial_state(flips.at, env)
    if initial is None:
        return -np.inf, np.inf
    return initial.most_of(flips.condition(given, env, None, initial.mask(flips.frames)))


def instance_keys(
    flips: FlipBands, rule: ast.Rule, env: Env, scopes: Sequence[Scope]
) -> list[Broken]:
    """Keys of a rule in each of its scopes, which do not depend on the parameter."""
    wanted = mask_of(scopes, flips.frames)
    bands = [flips.alternative(c.what, env, c.kind, wanted) for c in rule.clauses]
    out: list[Broken] = []
    for scope in scopes:
        keys = [
            clause_keys(flips, rule, clause.kind, band.at(scope.first, scope.stop), scope)
            for clause, band in zip(rule.clauses, bands, strict=True)
        ]
        out.append((max(a for a, _ in keys), max(b for _, b in keys)))
    return out


def clause_keys(
    flips: FlipBands, rule: ast.Rule, kind: ClauseKind, keys: Band, scope: Scope
) -> Broken:
    """Keys of one obligation in one scope; ``keys``: (stop − first,) those of its condition there."""
    window = flips.at.window(rule.for_).within(scope.first, scope.stop)
    if CLAUSES[kind].lasts and flips.is_moved(rule.for_) and len(keys.lower):
        if flips.reads(tuple(clause.what for clause in rule.clauses)):
            raise Undecided("it is a duration and more")
        ends = (np.where(scope.certain, keys.lower, -np.inf), keys.upper)
        keys = Band(
            *(lasting_keys(e, flips.counts, flips.value, flips.way, open_end=False) for e in ends)
        )
        window = Window(1)
    margin = OBLIGATIONS[kind].margin_of(keys, scope.sure, window)
    if scope.cut:
        margin = OBLIGATIONS[kind].cut(margin)
    return -margin.upper, -margin.lower


def keys_within(flips: FlipBands, rule: ast.Rule, env: Env, frames: Frames) -> Broken:
    """Keys of a rule whose scope depends on the parameter: broken at some frame that is in it."""
    inside, window = frames.inside, flips.at.window(rule.for_)
    if flips.is_moved(rule.for_) or window.stops is not None:
        raise Undecided("it moves a scope, and how long it must last there")
    wanted, broken, unkept = inside.upper != -np.inf, -np.inf, frames.cut
    for clause in rule.clauses:
        keys, breaks = (
            flips.alternative(clause.what, env, clause.kind, wanted),
            CLAUSES[clause.kind].breaks,
        )
        if breaks is None:
            raise Undecided("every stretch has to reach it")
        if breaks:
            keys = Band(np.minimum(inside.lower, keys.lower), np.minimum(inside.upper, keys.upper))
        else:
            keys = Band(
                np.maximum(-inside.upper, keys.lower), np.maximum(-inside.lower, keys.upper)
            )
        margin = OBLIGATIONS[clause.kind].margin_of(keys, None, window)
        broken, unkept = max(broken, -margin.upper), max(unkept, -margin.lower)
    return broken, unkept
