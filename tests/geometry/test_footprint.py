"""Seen from above: overlap and horizontal distance."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import any_shape, box, cylinder, put, shape, sphere, wanderer
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.episode import Geom
from safestage_eval.geometry.footprint import clearance_xy, footprint, overlap_xy
from safestage_eval.geometry.polygon import convex_hull, edges, nearest_on

CUBE = box(0.05, 0.05, 0.05)


def test_overlap_truths() -> None:
    under = put(CUBE, (0, 0, 0))
    assert overlap_xy(put(CUBE, (0.05, 0, 1)), under)[0] == pytest.approx(0.5)
    assert overlap_xy(put(CUBE, (0.025, 0.025, 1)), under)[0] == pytest.approx(0.5625)
    assert overlap_xy(put(CUBE, (0.2, 0, 1)), under)[0] == 0
    assert overlap_xy(put(CUBE, (0.2, 0, 1)), put(Geom(kind="plane"), (0, 0, 0)))[0] == 1
    assert overlap_xy(put(cylinder(0.03, 0.1), (0, 0, 1)), under)[0] == 1
    can, board = put(cylinder(0.03, 0.1), (0.05, 0, 1)), put(box(0.05, 0.5, 0.1), (0, 0, 0))
    assert overlap_xy(can, board)[0] == pytest.approx(0.5, abs=1e-9)
    shelf = put(shape(box(0.05, 0.1, 0.1), box(0.05, 0.1, 0.1, at=(0.1, 0, 0))), (0, 0, 0))
    assert overlap_xy(put(CUBE, (0.05, 0, 1)), shelf)[0] == pytest.approx(1)


def test_only_what_was_asked_for_and_rest_is_reused() -> None:
    p = np.zeros((10, 3))
    p[5:, 0] = 0.05
    mover = put(CUBE, p, np.tile([1.0, 0, 0, 0], (10, 1)))
    share = overlap_xy(mover, put(CUBE, (0, 0, 0)), np.array([3, 4, 5]))
    np.testing.assert_allclose(share[3:6], [1, 1, 0.5])
    assert np.isnan(share[[0, 1, 2, 6, 7, 8, 9]]).all()


def test_horizontal_distance_truths() -> None:
    def xy(a: object, b: object) -> tuple[float, float]:
        found = clearance_xy([a], [b])
        return float(found.lower[0]), float(found.upper[0])

    lower, upper = xy(put(sphere(0.03), (0.1, 0, 5)), put(sphere(0.03), (0, 0, 0)))
    assert lower - 1e-12 <= 0.04 <= upper + 1e-12
    lower, upper = xy(put(CUBE, (0.13, 0.14, 5)), put(CUBE, (0, 0, 0)))
    assert lower - 1e-12 <= 0.05 <= upper + 1e-12
    lying = (np.cos(np.pi / 4), np.sin(np.pi / 4), 0, 0)
    lower, upper = xy(put(cylinder(0.03, 0.1), (0.2, 0, 5), lying), put(CUBE, (0, 0, 0)))
    assert lower - 1e-12 <= 0.2 - 0.05 - 0.03 <= upper + 1e-12
    assert xy(put(CUBE, (0.05, 0, 1)), put(CUBE, (0, 0, 0)))[1] <= 0
    assert xy(put(CUBE, (9, 0, 1)), put(Geom(kind="plane"), (0, 0, 0)))[1] <= 0


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, deadline=None, max_examples=6)
def test_horizontal_distance_agrees_with_the_outlines(seed: int) -> None:
    """Against polygons of the projections, which are right to 0.1 mm on either side."""
    rng = np.random.default_rng(seed)
    a, b = wanderer(rng, 40, 0.4, 2), put(any_shape(rng, 2), (0, 0, 0))
    found = clearance_xy([a], [b])
    capped = clearance_xy([a], [b], 0.1)
    for t in range(0, 40, 5):
        least = np.inf
        for one in footprint(a, t):
            for other in footprint(b, t):
                least = min(
                    least,
                    nearest_on(one, edges(other)).distance.min(),
                    nearest_on(other, edges(one)).distance.min(),
                )
        if found.upper[t] <= 0:
            continue
        assert found.upper[t] - found.lower[t] <= 1e-9 or found.lower[t] < 1e-5
        assert found.lower[t] - 1e-9 <= least <= found.upper[t] + 2e-4
        if found.lower[t] > 0.1 + 1e-9:
            assert capped.upper[t] == np.inf
        else:
            assert capped.upper[t] == pytest.approx(found.upper[t], abs=2e-9)


def test_outlines_of_round_things_are_right_to_a_tenth_of_a_millimetre() -> None:
    for geom, radius in ((sphere(0.05), 0.05), (cylinder(0.15, 0.01), 0.15)):
        outline = footprint(put(geom, (1, 2, 3)), 0)[0]
        assert len(convex_hull(outline)) == len(outline)
        middles = (outline + np.roll(outline, 1, 0)) / 2
        assert np.linalg.norm(middles - [1, 2], axis=1).min() > radius - 1e-4
        assert np.linalg.norm(outline - [1, 2], axis=1).max() < radius + 1e-12
