"""Boxes fitted to corners: the analytic answer, and None for what has no volume."""

from __future__ import annotations

import numpy as np
import pytest

from safestage_eval.importers.box_fit import fit

SIGNS = np.array([[1 if i >> axis & 1 else -1 for axis in range(3)] for i in range(8)], float)
STILL = np.zeros((5, 3)), np.tile([1.0, 0, 0, 0], (5, 1))


def corners(half: tuple[float, float, float]) -> np.ndarray:
    return np.tile(SIGNS * half, (5, 1, 1))


def test_a_box_about_its_body() -> None:
    found = fit(corners((0.1, 0.02, 0.03)), *STILL)
    assert found is not None
    assert found.geom.size == pytest.approx((0.1, 0.02, 0.03))
    assert found.geom.position == pytest.approx((0, 0, 0), abs=1e-12)


@pytest.mark.parametrize("half", [(0.0, 0.1, 0.1), (0.0, 0.0, 0.0)])
def test_a_flat_box_has_no_volume(half: tuple[float, float, float]) -> None:
    assert fit(corners(half), *STILL) is None


@pytest.mark.parametrize("far", [1e18, 1e30, 1e300])
def test_a_body_so_far_away_that_its_corners_coincide(far: float) -> None:
    position, orientation = STILL
    assert fit(corners((0.1, 0.1, 0.1)), position + far, orientation) is None
