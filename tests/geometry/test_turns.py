"""Kernels over orientations against rotation matrices."""

from __future__ import annotations

import numpy as np
import pytest

from safestage_eval.geometry.pose import (
    angle,
    matrix,
    point_velocity,
    point_velocity_slowly,
    rotate,
)

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
    with pytest.raises(ValueError, match="norm 0"):
        point_velocity(*(broken[:, :n].astype(np.float32) for n in (3, 3, 4)), np.ones(3))


def test_the_velocity_of_a_point_is_that_of_the_slow_way_bit_for_bit() -> None:
    rng, point = np.random.default_rng(6), np.array([0.2, -0.1, 0.4])
    columns = [rng.normal(size=(200, n)).astype(np.float32) for n in (3, 3, 4)]
    assert (point_velocity(*columns, point) == point_velocity_slowly(*columns, point)).all()
    wide = [column.astype(np.float64) for column in columns]
    assert (point_velocity(*wide, point) == point_velocity_slowly(*columns, point)).all()
