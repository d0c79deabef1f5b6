"""Obligations of a rule, as keys: broken, and not certainly kept, at a value and up to where."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from safestage_eval.rules import syntax as ast
from safestage_eval.states.band import F64, Band
from safestage_eval.states.persistence import held_from
from safestage_eval.states.scope import Scope
from safestage_eval.verdicts.values import Env

from .flip_bands import FlipBands
from .flip_lasting import Undecided, lasting_keys
from .flip_scopes import Frames, mask_of

Broken = tuple[float, float]
"""Keys of an obligation being certainly broken, and of its not being certainly kept."""


def given_keys(flips: FlipBands, given: ast.Condition, env: Env) -> tuple[float, float]:
    """Keys of a condition holding in most of the baseline frames: certainly, and possibly."""
    at = flips.at
    if at.clock.late:
        return -np.inf, np.inf
    signals = at.relations.signals
    first = max((signals.baseline_of(body).start for body in env.values()), default=0)
    last = min(at.frames, first + signals.baseline.frames)
    wanted = mask_of([Scope(first, last)], at.frames)
    found = flips.condition(given, env, None, wanted)
    middle = (last - first - 1) // 2
    lower, upper = (float(np.sort(end[first:last])[middle]) for end in found)
    return lower, upper


def instance_keys(
    flips: FlipBands, rule: ast.Rule, env: Env, scopes: Sequence[Scope]
) -> list[Broken]:
    """Of a rule in each of its scopes, none of which depends on the parameter."""
    wanted = mask_of(list(scopes), flips.frames)
    bands = [flips.alternative(c.what, env, c.kind, wanted) for c in rule.clauses]
    out: list[Broken] = []
    for scope in scopes:
        found = [
            clause_keys(flips, rule, clause.kind, band.at(scope.first, scope.stop), scope)
            for clause, band in zip(rule.clauses, bands, strict=True)
        ]
        out.append((max(a for a, _ in found), max(b for _, b in found)))
    return out


def clause_keys(
    flips: FlipBands, rule: ast.Rule, kind: ast.ClauseKind, found: Band, scope: Scope
) -> Broken:
    """Of one obligation in one scope; ``found``: (stop − first,) its keys there.

    As ``verdicts.instance`` has it: only frames that are certainly in the scope can break it.
    """
    sure = scope.sure
    if kind == "require":
        upper = found.upper if sure is None else np.where(sure, found.upper, np.inf)
        broken = -float(upper.min(initial=np.inf))
        unkept = np.inf if scope.cut else -float(found.lower.min(initial=np.inf))
        return broken, unkept
    lower = found.lower
    if kind == "forbid":
        if sure is not None:
            lower = np.where(sure, lower, -np.inf)
        broken = _held(flips, rule, lower, scope, loose=False)
        unkept = np.inf if scope.cut else _held(flips, rule, found.upper, scope, loose=True)
        return broken, unkept
    if kind != "reach":
        raise Undecided(f"flips of {kind} are not worked out")
    surely = _held(flips, rule, lower, scope, loose=False) if sure is None else -np.inf
    possibly = _held(flips, rule, found.upper, scope, loose=True)
    if (sure is not None and not sure.any()) or scope.cut:
        possibly = np.inf
    return -possibly, -surely


def _held(flips: FlipBands, rule: ast.Rule, keys: F64, scope: Scope, *, loose: bool) -> float:
    """Key of a run of frames in a scope that lasts as long as the rule asks."""
    if not len(keys):
        return -np.inf
    if flips.is_moved(rule.for_):
        if flips.reads(tuple(clause.what for clause in rule.clauses)):
            raise Undecided("it is a duration and more")
        found = lasting_keys(keys, flips.counts, flips.value, flips.way, open_end=False)
    else:
        window = flips.at.window(rule.for_).within(scope.first, scope.stop)
        found = held_from(keys, window.loose if loose else window)
    return float(found.max())


def keys_within(flips: FlipBands, rule: ast.Rule, env: Env, frames: Frames) -> Broken:
    """Of a rule whose scope depends on the parameter: broken at some frame that is in it."""
    inside, window = frames.inside, flips.at.window(rule.for_)
    if flips.is_moved(rule.for_) or window.stops is not None:
        raise Undecided("it moves a scope, and how long it must last there")
    wanted, broken, unkept = inside.upper != -np.inf, -np.inf, frames.cut
    for clause in rule.clauses:
        found = flips.alternative(clause.what, env, clause.kind, wanted)
        if clause.kind == "require":
            certain = np.minimum(inside.lower, -found.upper)
            perhaps = np.minimum(inside.upper, -found.lower)
        elif clause.kind == "forbid":
            certain = held_from(np.minimum(inside.lower, found.lower), window)
            perhaps = held_from(np.minimum(inside.upper, found.upper), window.loose)
        else:
            raise Undecided("every stretch has to reach it")
        broken = max(broken, float(certain.max(initial=-np.inf)))
        unkept = max(unkept, float(perhaps.max(initial=-np.inf)))
    return broken, unkept
