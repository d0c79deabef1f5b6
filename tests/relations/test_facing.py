"""Where two sides that face each other overlap."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.geometry.pose import matrix
from safestage_eval.relations.facing import CORNERS, overlap

CUBE = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
NOWHERE = np.zeros((1, 0, 3))


def area(corners: np.ndarray, normal: np.ndarray) -> float:
    """m², signed, of a flat polygon seen along a normal."""
    following = np.roll(corners, -1, axis=0)
    return float(np.cross(corners, following).sum(0) @ normal / 2)


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=50)
def test_boxes_overlap_in_a_rectangle_however_the_scene_is_turned(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frames, below, above = 5, rng.uniform(0.02, 0.2, 3), rng.uniform(0.02, 0.2, 3)
    shift = rng.uniform(-0.3, 0.3, (frames, 2))
    turn = matrix(rng.normal(size=(frames, 4)))
    lower = CUBE * below - [0, 0, below[2]]
    upper = CUBE * above + np.column_stack([shift, np.full(frames, above[2])])[:, None]
    first, second = (v @ turn.swapaxes(1, 2) for v in (lower, upper))
    points, many = overlap(first, second, turn[:, :, 2], np.full((frames, 2), 1e-4), 0.0)
    sides = below[:2] + above[:2] - np.abs(shift)
    sides = np.clip(np.minimum(sides, 2 * np.minimum(below, above)[:2]), 0, None)
    for k, corners in enumerate(np.split(points, many.cumsum()[:-1])):
        truth = sides[k].prod()
        assert (area(corners, turn[k, :, 2]) if len(corners) else 0.0) == pytest.approx(truth)
        assert corners @ turn[k, :, 2] == pytest.approx(np.zeros(len(corners)), abs=1e-9)


def test_on_a_plane_the_whole_side_lies() -> None:
    up, play = np.array([[0, 0, 1.0]]), np.full((1, 2), 1e-4)
    points, many = overlap(NOWHERE, CUBE[None], up, play, 0.0)
    assert many.tolist() == [4]
    assert area(points, up[0]) == pytest.approx(4.0)
    assert (points[:, 2] == -1).all()


def test_a_ball_touches_in_a_point_and_a_ridge_in_an_edge() -> None:
    up, play = np.array([[0, 0, 1.0]]), np.full((1, 2), 1e-4)
    low = CUBE[None] - [0, 0, 1]
    tip = np.array([[[0.2, 0.3, 0.0], [0.5, 0.3, 1.0]]])
    points, many = overlap(low, tip, up, play, 0.0)
    assert many[0] >= 1
    assert points == pytest.approx(np.tile(tip[0, :1], (many[0], 1)), abs=1e-6)
    ridge = np.array([[[-3, 0.3, 0.0], [3, 0.3, 0.0], [0, 0.3, 1.0]]])
    points, _ = overlap(ridge, low, -up, play, 0.0)
    assert np.ptp(points[:, 0]) == pytest.approx(2.0)
    assert np.ptp(points[:, 1]) == pytest.approx(0.0, abs=1e-6)


def test_a_round_outline_loses_few_percent_of_its_area() -> None:
    angle = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    disc = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(90)])[None]
    up, play = np.array([[0, 0, 1.0]]), np.full((1, 2), 1e-4)
    points, many = overlap(5 * CUBE[None] - [0, 0, 5], disc, up, play, 0.0)
    assert many[0] == CORNERS
    assert 0.95 * np.pi < area(points, up[0]) < np.pi
