"""Kernels over contacts find what plain NumPy finds."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.episode.invariant_kernels import peak_below


def first_below(frame, force, normal, peak, every):
    """The same, of whole columns."""
    rows = np.flatnonzero(frame % every == 0)
    push, way = force[rows].astype(np.float64), normal[rows].astype(np.float64)
    unit = np.abs((way * way).sum(axis=1) - 1) < 0.01
    along = np.where(unit, np.abs((push * way).sum(axis=1)), 0)
    total = np.bincount(frame[rows], along, minlength=int(frame.max(initial=0)) + 1)[frame[rows]]
    less = peak[rows] < 0.99 * total - 1e-2
    return int(rows[less.argmax()]) if less.any() else -1


@given(st.integers(0, 2**32 - 1), st.integers(0, 60), st.sampled_from([1, 4, 8]), st.floats(0, 1))
def test_peaks_below_the_force_of_their_pair(seed, rows, every, share):
    rng = np.random.default_rng(seed)
    frame = rng.integers(0, 20, rows).astype(np.int32)
    normal = rng.normal(size=(rows, 3)).astype(np.float32)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal[rng.random(rows) < 0.1] *= 3
    force = rng.normal(size=(rows, 3)).astype(np.float32)
    for column in (normal, force):
        column[rng.random(rows) < 0.05] = np.nan
    peak = (12 * share * rng.random(rows)).astype(np.float32)
    sums = np.zeros(19 // every + 1)
    found = peak_below(frame, force, normal, peak, every, sums)
    assert found == first_below(frame, force, normal, peak, every)
