"""Pruning against no pruning: every frame, every pair, every geom, from scratch."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from bodies import put, wanderer

from safestage_eval.episode import Geom
from safestage_eval.geometry.gjk import geom_distance, relative_pose, scratch
from safestage_eval.geometry.group_clearance import SLACK, clearance_series
from safestage_eval.geometry.mover import Mover, rotation_at
from safestage_eval.geometry.support_function import Pair

LIMITS = (0.002, 0.01, 0.03, 0.05, 0.1, 0.25)


@numba.njit
def exhaustive(A, B, ma, mb, lower, upper):
    """Each distance a cold start of its own, with nothing carried over and no bar to stop at."""
    RA, RB, R = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    p, gap, up, out, work = np.empty(3), np.empty(3), np.zeros(3), np.empty(2), scratch()
    at_a, at_b = np.zeros((4, 3)), np.zeros((4, 3))
    for t in range(lower.shape[0]):
        i, j = min(t, ma.centre.shape[0] - 1), min(t, mb.centre.shape[0] - 1)
        rotation_at(ma.orientation, i, RA)
        rotation_at(mb.orientation, j, RB)
        gap[:] = mb.centre[j] - ma.centre[i]
        for a in range(A.kind.shape[0]):
            for b in range(B.kind.shape[0]):
                pair = Pair(A, a, B, b, R, p, up)
                relative_pose(pair, RA, RB, gap, work)
                geom_distance(pair, at_a, at_b, 0, np.inf, False, work, out)
                lower[t], upper[t] = min(lower[t], out[0]), min(upper[t], out[1])


def truth(a: Mover, b: Mover, frames: int) -> tuple[np.ndarray, np.ndarray]:
    lower, upper = np.full(frames, np.inf), np.full(frames, np.inf)
    exhaustive(a.shape.solids, b.shape.solids, a.motion, b.motion, lower, upper)
    return lower, upper


@pytest.mark.slow
def test_a_million_decisions_agree() -> None:
    """Frame × pair × limit: below, or not; with and without slack."""
    decided, open_, disagreements = 0, 0, 0
    for seed in range(7):
        rng = np.random.default_rng(seed)
        frames = 2000
        target = wanderer(rng, frames, 0.2, 3)
        others = [wanderer(rng, frames, 0.2, 2) for _ in range(10)]
        others += [wanderer(rng, 1, 0.3, 3), put(Geom(kind="plane"), (0, 0, -0.3))]
        for other in others:
            lower, upper = truth(target, other, frames)
            loose = clearance_series([target], [other], 0.25 + 1e-6, slack=SLACK)
            for limit in LIMITS:
                found = clearance_series([target], [other], limit * (1 + 1e-6) + 1e-6)
                both = [found] if loose.leaves_open(limit) else [found, loose]
                for series in both:
                    above, below = series.lower > limit, series.upper <= limit
                    disagreements += int((above & (upper <= limit)).sum())
                    disagreements += int((below & (lower > limit)).sum())
                    sure = (above | below) & ((lower > limit) | (upper <= limit))
                    decided += int(sure.sum())
                    open_ += int((~sure).sum())
    assert disagreements == 0
    assert decided >= 1_000_000
    assert open_ <= 20
