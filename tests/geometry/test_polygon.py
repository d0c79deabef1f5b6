"""Hulls, unions and their areas against closed forms and sampling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from safestage_eval.geometry.polygon import (
    contains,
    convex_hull,
    crosses,
    edges,
    grown,
    loops,
    nearest_on,
    overlap,
    union_area,
    union_outline,
)

few = settings(derandomize=True, deadline=None, max_examples=20)


def rectangle(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], float)


def length(outline: np.ndarray) -> float:
    return float(np.linalg.norm(outline[:, 1] - outline[:, 0], axis=1).sum())


@given(st.integers(0, 2**32 - 1))
@few
def test_hull_agrees_with_qhull(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(60, 2))
    mine, other = convex_hull(points), ConvexHull(points)
    assert len(mine) == len(other.vertices)
    assert union_area([mine]) == pytest.approx(other.volume)
    assert contains([mine], points).all()


def test_hull_of_little() -> None:
    assert len(convex_hull(np.zeros((0, 2)))) == 0
    assert len(convex_hull(np.array([[1.0, 2.0]] * 3))) == 1
    assert len(convex_hull(np.array([[0.0, 0], [1, 1], [2, 2]]))) == 2
    assert len(convex_hull(np.array([[0.0, 0], [1, 0], [2, 0], [2, 1], [0, 1], [1, 1]]))) == 4


def test_truths() -> None:
    cross = [rectangle(-1, -3, 1, 3), rectangle(-3, -1, 3, 1)]
    assert union_area(cross) == pytest.approx(20)
    assert length(union_outline(cross)) == pytest.approx(24)
    abutting = [rectangle(0, 0, 1, 1), rectangle(1, 0, 2, 1), rectangle(2, 0, 3, 1)]
    assert union_area(abutting) == pytest.approx(3)
    assert length(union_outline(abutting)) == pytest.approx(8)
    twice = [rectangle(0, 0, 1, 1), rectangle(0, 0, 1, 1), rectangle(0.5, 0, 1, 1)]
    assert union_area(twice) == pytest.approx(1)
    assert length(union_outline(twice)) == pytest.approx(4)
    ring = [
        rectangle(0, 0, 3, 1),
        rectangle(0, 2, 3, 3),
        rectangle(0, 0, 1, 3),
        rectangle(2, 0, 3, 3),
    ]
    assert union_area(ring) == pytest.approx(8)
    assert length(union_outline(ring)) == pytest.approx(16)
    assert union_area([]) == 0
    assert union_area([np.array([[0.0, 0], [1, 1]])]) == 0


@given(st.integers(0, 2**32 - 1))
@few
def test_union_area_agrees_with_sampling(seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts = [convex_hull(rng.uniform(0, 0.6, (6, 2)) + rng.uniform(0, 0.4, 2)) for _ in range(5)]
    side = (np.arange(400) + 0.5) / 400
    grid = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    assert union_area(parts) == pytest.approx(contains(parts, grid).mean(), abs=4e-3)
    assert union_area(parts[::-1]) == pytest.approx(union_area(parts))


def test_growing_moves_every_edge() -> None:
    wider = grown(rectangle(0, 0, 2, 1), 0.1)
    np.testing.assert_allclose(wider, rectangle(-0.1, -0.1, 2.1, 1.1))
    needle = np.array([[0.0, 0], [1, -0.001], [1, 0.001]])
    assert np.linalg.norm(grown(needle, 1e-5) - needle, axis=1).max() <= 4e-5


def test_nearest_and_crossing() -> None:
    square = edges(rectangle(0, 0, 1, 1))
    found = nearest_on(np.array([[0.5, 2.0], [2.0, 2.0], [0.4, 0.1]]), square)
    np.testing.assert_allclose(found.distance, [1, np.sqrt(2), 0.1])
    np.testing.assert_allclose(found.foot, [[0.5, 1], [1, 1], [0.4, 0]])
    assert found.segment.tolist()[::2] == [2, 0]
    starts, ends = np.array([[0.5, 0.5]] * 2), np.array([[0.5, 0.9], [0.5, 1.1]])
    assert crosses(starts, ends, square).tolist() == [False, True]


@given(st.integers(0, 2**32 - 1))
@few
def test_what_two_polygons_share_has_the_area_that_their_union_lacks(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = (convex_hull(rng.normal(size=(9, 2)) + rng.uniform(-1, 1, 2)) for _ in range(2))
    shared = overlap(a, b)
    area = union_area([shared]) if len(shared) else 0.0
    assert area == pytest.approx(union_area([a]) + union_area([b]) - union_area([a, b]), abs=1e-9)
    assert union_area([overlap(b, a)]) == pytest.approx(area, abs=1e-9)
    assert contains([a], shared).all()


def test_what_only_touches_shares_nothing() -> None:
    assert len(overlap(rectangle(0, 0, 1, 1), rectangle(1, 0, 2, 1))) == 0
    assert len(overlap(rectangle(0, 0, 1, 1), np.array([[0.2, 0.2], [0.8, 0.8]]))) == 0


def test_boundaries_and_holes_are_counted() -> None:
    sides = [rectangle(0, 0, 3, 1), rectangle(0, 2, 3, 3), rectangle(0, 0, 1, 3)]
    assert loops(union_outline(sides[:1])) == 1
    assert loops(union_outline(sides[:2])) == 2
    assert loops(union_outline(sides)) == 1
    assert loops(union_outline([*sides, rectangle(2, 0, 3, 3)])) == 2
