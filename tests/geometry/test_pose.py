"""Rotations and poses: group laws, exact rest, an independent oracle."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from safestage_eval.geometry import pose

seeds = st.integers(0, 2**32 - 1)


def some(seed: int, n: int = 20) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=(n, 3)), pose.unit(rng.normal(size=(n, 4)))


@given(seeds)
@settings(derandomize=True, deadline=None, max_examples=20)
def test_agrees_with_scipy(seed: int) -> None:
    p, q = some(seed)
    _, r = some(seed + 1)
    mine, other = (Rotation.from_quat(x, scalar_first=True) for x in (q, r))
    np.testing.assert_allclose(pose.matrix(q), mine.as_matrix(), atol=1e-14)
    np.testing.assert_allclose(pose.rotate(q, p), mine.apply(p), atol=1e-13)
    turned = (mine * other).as_quat(scalar_first=True)
    same = np.abs((pose.product(q, r) * turned).sum(1))
    np.testing.assert_allclose(same, 1, atol=1e-13)
    np.testing.assert_allclose(pose.angle(q, r), (mine.inv() * other).magnitude(), atol=1e-12)


@given(seeds)
@settings(derandomize=True, deadline=None, max_examples=20)
def test_inverse_and_relative_undo_what_was_done(seed: int) -> None:
    p, q = some(seed)
    point, r = some(seed + 1)
    there = pose.transform(p, q, point)
    np.testing.assert_allclose(pose.inverse_transform(p, q, there), point, atol=1e-13)
    seen_p, seen_q = pose.relative(p, q, point, r)
    again_p, again_q = pose.compose(p, q, seen_p, seen_q)
    np.testing.assert_allclose(again_p, point, atol=1e-13)
    np.testing.assert_allclose(pose.angle(again_q, r), 0, atol=1e-7)


def test_a_resting_body_has_turned_by_exactly_nothing() -> None:
    q = np.float32([0.7071, 0.1, -0.3, 0.6])
    assert pose.angle(q, q) == 0.0
    assert pose.angle(q, -q) == 0.0


@pytest.mark.parametrize("turn", [1e-9, 1e-6, 1e-3, 1.0, 3.0, np.pi])
def test_small_angles_keep_their_digits(turn: float) -> None:
    q = [np.cos(turn / 2), np.sin(turn / 2), 0, 0]
    assert pose.angle([1, 0, 0, 0], q) == pytest.approx(turn, rel=1e-7)


def test_the_mean_ignores_signs_and_stays_put() -> None:
    q = pose.unit([[1, 0.1, 0, 0], [-1, 0.1, 0, 0]])
    assert pose.angle(pose.mean_orientation(q), [1, 0, 0, 0]) < 1e-7
    still = np.tile(np.float32([0.6, 0, 0.8, 0]), (5, 1))
    assert pose.angle(pose.mean_orientation(still), still[0]) == 0.0


@pytest.mark.parametrize("bad", [[0, 0, 0, 0], [np.nan, 0, 0, 1], [np.inf, 0, 0, 1]])
def test_what_is_no_rotation_is_refused(bad: list[float]) -> None:
    with pytest.raises(ValueError, match="norm 0 or is not finite"):
        pose.matrix(bad)
