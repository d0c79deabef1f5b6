"""Untouched bodies fall, also in rare samples."""

import numpy as np
import pytest
from scenes import G, Scene

from safestage_eval.doubts import contradictions

FRAMES = 16


def contradicted(rate, path=(-0.3, 0, 0.05), touched=(), lost=(), **fields):
    """Problems of a box on a path, in a scene where another one rests on a table."""
    scene = Scene(FRAMES, rate).fixed("table").box("b", 0.05, (0.3, 0, 0.05))
    scene.rests("b", "table", 0.05, (0.3, 0, 0), G).box("a", 0.05, path, **fields)
    for frame in touched:
        scene.rests("a", "table", 0.05, (-0.3, 0, 0), G, frames=slice(frame, frame + 1))
    for frame in lost:
        scene.tracks["a"].position[frame] = np.nan
    return [str(e) for e in contradictions(scene.episode())]


@pytest.mark.parametrize("rate", [2.0, 4.0, 12.0])
def test_a_body_that_stays_where_nothing_touches_it_is_refused(rate):
    [found] = contradicted(rate)
    assert "'a' does not fall at 0.000 s, though nothing touches it for" in found
    assert contradicted(rate, lost=[2])


@pytest.mark.parametrize("rate", [2.0, 12.0])
def test_a_body_that_is_touched_moves_or_needs_no_bearer_is_not(rate):
    assert not contradicted(rate, touched=range(FRAMES))
    assert not contradicted(rate, touched=range(0, FRAMES, 2))
    moving = np.column_stack([0.001 * np.arange(FRAMES), np.zeros(FRAMES), np.full(FRAMES, 0.05)])
    assert not contradicted(rate, moving)
    assert not contradicted(rate, mass=None)
    assert not contradicted(rate, mass=0.0)
    assert not contradicted(rate, parent="b")
    assert not contradicted(rate, lost=range(FRAMES - 2))


def test_a_short_stay_may_be_the_top_of_a_throw():
    """Eleven samples at 12 Hz are 0.9 s; two samples at 2 Hz tell nothing."""
    assert not contradicted(12.0, touched=range(5))
    assert not contradicted(2.0, touched=range(2, FRAMES))


def test_air_may_slow_what_falls():
    """A carton of 20 g falls no faster than 6 m/s."""
    rate, fastest = 100.0, 6.0
    t = np.arange(200) / rate
    z = 11 - fastest**2 / 9.81 * np.log(np.cosh(9.81 * t / fastest))
    scene = Scene(len(t), rate).fixed("table").box("b", 0.05, (0.3, 0, 0.05))
    scene.rests("b", "table", 0.05, (0.3, 0, 0), G)
    scene.box("a", 0.05, np.column_stack([np.full_like(z, -0.3), np.zeros_like(z), z]))
    assert not [e for e in contradictions(scene.episode()) if "does not fall" in str(e)]
