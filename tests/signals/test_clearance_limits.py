"""Clearances are as exact as the limits they are compared with need them."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.episode import Geom
from safestage_eval.evidence.measure import Signals


def trembling() -> Signals:
    """Two cubes about 10 cm apart, one of which trembles by a micrometre."""
    rng = np.random.default_rng(0)
    path = np.array([0.0, 0.0, 0.5]) + rng.normal(size=(300, 3)) * 1e-6
    scene = Scene(300).box("still", 0.05, (-0.18, 0, 0.5)).box("shaking", 0.05, path)
    return Signals(scene.episode())


def test_wider_bounds_decide_the_same() -> None:
    signals = trembling()
    exact = signals.get("clearance", ["shaking", "still"])
    assert (exact.upper - exact.lower).max() <= 1e-9
    wide = signals.get("clearance", ["shaking", "still"], limits=[0.07])
    assert 1e-9 < (wide.upper - wide.lower).max() <= 2.1e-5
    assert (wide.lower <= exact.upper).all()
    assert (exact.lower <= wide.upper).all()


def test_a_limit_within_the_bounds_is_measured_again() -> None:
    """Also when the wide series is known already: a limit that is changed is decided anew."""
    signals = trembling()
    exact = signals.get("clearance", ["shaking", "still"])
    for limit in np.quantile(exact.upper, [0.1, 0.5, 0.9]) + 1e-8:
        found = signals.get("clearance", ["shaking", "still"], limits=[0.07, limit])
        assert ((found.lower > limit) | (found.upper < limit)).all()
        np.testing.assert_array_equal(found.lower > limit, exact.lower > limit)


def test_depths_are_measured_for_limits_up_to_zero() -> None:
    can = Geom(kind="cylinder", size=(0.05, 0.05))
    scene = Scene(4).body("a", can, (0, 0, 0.5)).body("b", can, (0.09, 0, 0.5))
    signals = Signals(scene.episode())
    positive = signals.get("clearance", ["a", "b"], limits=[0.02])
    assert (positive.upper <= 0).all()
    for limits in ([0.0], [-0.02, 0.05]):
        deep = signals.get("clearance", ["a", "b"], limits=limits)
        assert deep.upper[0] == pytest.approx(-0.01, abs=1e-6)
        assert (deep.upper - deep.lower).max() <= 1e-6


def test_another_backend_is_asked() -> None:
    """python-fcl says 18 cm of two standing cylinders that are 2 cm apart."""
    thin, thick = (Geom(kind="cylinder", size=size) for size in ((0.03, 0.05), (0.05, 0.15)))
    scene = Scene(2).body("a", thin, (0, 0, 0.5)).body("b", thick, (-0.1, 0, 0.52))
    wrong = Signals(scene.episode(), backend="fcl").get("clearance", ["a", "b"])
    right = Signals(scene.episode()).get("clearance", ["a", "b"])
    np.testing.assert_allclose(right.upper, 0.02, atol=1e-7)
    assert (wrong.lower >= 0.1).all()
