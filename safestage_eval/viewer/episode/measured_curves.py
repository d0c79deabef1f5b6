"""Measurements and states over time, thinned out for a drawing: no extreme value is lost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.units import format_quantity, in_unit, unit_of
from safestage_eval.verdicts.curves import Bound, Curve, Lane

F64 = NDArray[np.float64]

COLUMNS = 320
"""Pieces that time is cut into; the least and the greatest value of each are kept."""


def curve_data(t: F64, curve: Curve, moments: Sequence[float | None] = ()) -> dict[str, Any]:
    """A measurement in the unit that it is shown in; what was measured at ``moments`` (s) is kept.

    ``t`` are s; ``v`` values, null where nothing was measured; ``least`` likewise, where only that
    much is known: at least so far apart.
    """
    dimension = curve.series.dimension
    lower, upper = curve.series.lower, curve.series.upper
    least = np.isfinite(lower) & ~np.isfinite(upper)
    shown = curve.series.value * in_unit(1.0, dimension)
    asked = np.searchsorted(t, [at - 1e-6 for at in moments if at is not None])
    named = [int(frame) for frame in asked if frame < len(t) and np.isfinite(shown[frame])]
    frames = sorted({*thinned(t, shown), *named})
    return {
        "signal": curve.signal,
        "unit": unit_of(dimension),
        "limits": [_limit(bound, dimension) for bound in curve.limits],
        "t": [round(float(t[i]), 3) for i in frames],
        "v": [_number(shown[i]) if not least[i] else None for i in frames],
        "least": [_number(shown[i]) if least[i] else None for i in frames] if least.any() else None,
    }


def lane_data(t: F64, lane: Lane) -> dict[str, Any]:
    """[from, to] s of where a state is true, and of where that is not known."""
    return {
        "name": lane.name,
        "true": spans_of(t, runs(lane.true)),
        "unknown": spans_of(t, runs(~lane.known)),
    }


def spans_of(t: F64, stretches: Sequence[tuple[int, int]]) -> list[list[float]]:
    """Frames [first, stop) as [from, to] s."""
    last = len(t) - 1
    return [
        [round(float(t[min(a, last)]), 3), round(float(t[min(b, last)]), 3)] for a, b in stretches
    ]


def runs(true: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """[first, stop) of the stretches that are true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], true, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def thinned(t: F64, values: F64) -> list[int]:
    """Frames that show what all do: the least and the greatest of each column, ends of gaps.

    Frames that were not measured, between others that were, do not break the curve unless more of
    them follow each other than ``frames_to_measure`` leaves out.
    """
    measured = np.flatnonzero(np.isfinite(values))
    if not len(measured):
        return []
    column = ((t[measured] - t[0]) / max(t[-1] - t[0], 1e-9) * (COLUMNS - 1)).astype(int)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(column)) + 1])
    group = np.repeat(np.arange(len(starts)), np.diff([*starts, len(column)]))
    picked = [measured[[0, -1]]]
    for extreme in (np.minimum, np.maximum):
        there = values[measured] == extreme.reduceat(values[measured], starts)[group]
        _, first = np.unique(group[there], return_index=True)
        picked.append(measured[there][first])
    wide = 2 * len(t) / 240 + 2
    gaps = np.flatnonzero(np.diff(measured) - 1 > wide)
    picked += [measured[gaps], measured[gaps] + 1, measured[gaps + 1]]
    return [int(frame) for frame in np.unique(np.concatenate(picked))]


def _limit(bound: Bound, dimension: str) -> dict[str, Any]:
    said = format_quantity(bound.value, dimension)
    return {
        "value": in_unit(bound.value, dimension),
        "bad": bound.bad,
        "said": f"{bound.param} {said}" if bound.param else f"limit {said}",
    }


def _number(value: float) -> float | None:
    return float(f"{value:.4g}") if np.isfinite(value) else None
