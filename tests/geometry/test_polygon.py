"""Hulls and margins of support polygons against closed forms, SciPy and sampling."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from safestage_eval.geometry.polygon import clip, contains, convex_hull, polygon_margin

few = settings(derandomize=True, deadline=None, max_examples=20)
SQUARE = np.array([[0.0, 0], [2, 0], [2, 1], [0, 1]])


def area(polygon: np.ndarray) -> float:
    """m², positive where the corners go around counter-clockwise."""
    x, y = polygon.T
    return float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)


@given(st.integers(0, 2**32 - 1))
@few
def test_hull_agrees_with_qhull(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(60, 2))
    mine, other = convex_hull(points), ConvexHull(points)
    assert len(mine) == len(other.vertices)
    assert area(mine) == pytest.approx(other.volume)
    assert contains(mine, points).all()


@given(st.integers(0, 2**32 - 1))
@few
def test_a_clipped_polygon_is_what_lies_in_both(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = (convex_hull(rng.normal(size=(9, 2)) + rng.uniform(-1, 1, 2)) for _ in range(2))
    part = clip(a, b)
    grid = rng.uniform(-3, 3, (20_000, 2))
    both = (contains(a, grid) & contains(b, grid)).mean() * 36
    assert (area(part) if len(part) else 0.0) == pytest.approx(both, abs=0.2)


@pytest.mark.parametrize(
    ("centre", "margin"),
    [((1, 0.5), 0.5), ((1.8, 0.5), 0.2), ((2, 0.5), 0), ((2.3, 0.5), -0.3), ((2.3, 1.4), -0.5)],
)
def test_a_margin_is_the_distance_to_the_nearest_edge(
    centre: tuple[float, float], margin: float
) -> None:
    inner = np.array([[0.7, 0.5], [1, 1]])
    points = np.concatenate([SQUARE[::-1], inner])
    assert polygon_margin(points, np.zeros(6, int), np.array([centre])) == pytest.approx(margin)
