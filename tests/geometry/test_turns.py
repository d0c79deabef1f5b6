"""Kernels over orientations against rotation matrices."""

from __future__ import annotations

import numpy as np
import pytest

from safestage_eval.geometry.pose import angle, matrix, rotate

SOME = np.random.default_rng(5).normal(size=(200, 4)) * 3.0


def test_a_vector_turned_by_many_is_their_matrices_times_it() -> None:
    vector = np.array([0.3, -2.0, 0.7])
    assert np.abs(rotate(SOME, vector) - matrix(SOME) @ vector).max() < 1e-14


def test_angles_are_those_of_the_relative_rotation() -> None:
    for other in (SOME[::-1], SOME[3]):
        trace = np.einsum("tij,tij->t", matrix(SOME), np.broadcast_to(matrix(other), (200, 3, 3)))
        cosine = np.clip((trace - 1) / 2, -1, 1)
        assert np.abs(np.cos(angle(SOME, other)) - cosine).max() < 1e-13
    assert (angle(SOME, SOME) == 0).all()
    assert (angle(SOME, -SOME) == 0).all()


@pytest.mark.parametrize("bad", [0.0, np.nan, np.inf])
def test_what_is_no_rotation_is_refused(bad: float) -> None:
    broken = SOME.copy()
    broken[7] = bad
    with pytest.raises(ValueError, match="norm 0"):
        rotate(broken, np.array([1.0, 0.0, 0.0]))
    with pytest.raises(ValueError, match="norm 0"):
        angle(SOME, broken)
