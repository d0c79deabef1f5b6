"""Conditions in a few frames of an episode: what needs no other frames is measured there alone."""

from __future__ import annotations

import numpy as np

from safestage_eval.evidence.series import Series
from safestage_eval.rules import syntax as ast
from safestage_eval.states import band
from safestage_eval.states.band import Band, Bool
from safestage_eval.states.scope import Scope

from .costly import is_costly
from .evaluate import Evaluator
from .values import Env

SHARE = 4
"""In an episode so many times as long, a scope is looked at by itself."""


def is_brief(evaluator: Evaluator, scope: Scope) -> bool:
    """So few of the frames are judged that it pays to look at nothing else."""
    return 0 < SHARE * (scope.stop - scope.first) <= evaluator.frames


def series_within(
    evaluator: Evaluator, atom: ast.SignalAtom, env: Env, first: int, stop: int
) -> Series | None:
    """The signal of an atom in the frames [first, stop) alone; None where it needs others."""
    if evaluator.store.lasting:  # which keeps whole series
        return None
    measurement, reference = evaluator.asked(atom, env), None
    if atom.since is not None:
        reference, when = evaluator.since(atom.since, env)
        if when is not None:
            return None
    series = evaluator.relations.signals.stretch(
        measurement.name, measurement.bodies, reference, measurement.options, slice(first, stop)
    )
    if series is not None:
        evaluator.notes.update(dict.fromkeys(series.notes))
    return series


def condition_within(
    evaluator: Evaluator,
    condition: ast.Condition,
    env: Env,
    first: int,
    stop: int,
    wanted: Bool | None,
) -> Band:
    """Evaluate a condition in the frames [first, stop) alone: (stop − first,)."""
    bands: list[Band] = []
    for atom in sorted(condition.atoms, key=is_costly):
        costly = evaluator.asks_costly(atom)
        if type(atom) is ast.SignalAtom and not costly:
            series = series_within(evaluator, atom, env, first, stop)
            if series is not None:
                bands.append(evaluator.margins(series, atom, evaluator.asked(atom, env)))
                continue
        mask = wanted
        if mask is not None and costly:
            mask = mask.copy()
            for decided in bands:
                mask[first:stop] &= decided.upper != -np.inf
        bands.append(evaluator.atom(atom, env, mask).at(first, stop))
    return band.both(bands, stop - first)
