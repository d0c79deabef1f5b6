"""Forces on what rests are compared with its weight over time, for what rattles is borne so."""

import numpy as np
import pytest
from scenes import G, Scene

from safestage_eval.doubts import contradictions

FRAMES, RATE = 480, 120.0
T = np.arange(FRAMES) / RATE


def unborne(share, swings=0.0, hertz=10.0):
    """Codes of what is found of a box of 1 kg on a table.

    Args:
        share: (T,) of its weight that the table bears.
        swings: share of its weight by which what bears it does in truth go up and down …
        hertz: … so often: the box goes up and down against it.
    """
    turn = 2 * np.pi * hertz
    z = 0.05 - swings * 9.81 / turn**2 * np.cos(turn * T)
    scene = Scene(FRAMES, RATE).fixed("table")
    scene.box("a", 0.05, np.column_stack([0 * T, 0 * T, z]))
    for frame, borne in enumerate(share):
        one = slice(frame, frame + 1)
        scene.rests("a", "table", 0.05, (0, 0, 0), borne * G, frames=one)
    return [e.code for e in contradictions(scene.episode())]


def rattling(swings, hertz):
    return 1 + swings * np.cos(2 * np.pi * hertz * T)


@pytest.mark.parametrize("swings", [-0.95, 0.95, 1.0])
@pytest.mark.parametrize("hertz", [10.0, 20.0, 30.0])
def test_a_body_that_rattles_is_borne_over_time(hertz, swings):
    assert unborne(rattling(swings, hertz), swings, hertz) == []


@pytest.mark.parametrize("times", [0.1, -1.0, 2.5])
@pytest.mark.parametrize("swings", [0.0, -0.95, 0.95])
def test_a_rattle_whose_mean_bears_another_weight_is_refused(swings, times):
    assert unborne(times * rattling(swings, 10.0), swings, 10.0) == ["AUD123"]


def test_forces_that_are_wrong_for_a_while_are_refused():
    """Not only at the moments that are looked at first: a third of a second without any."""
    assert unborne(np.where((T > 2) & (T < 2.35), 0.0, 1.0)) == ["AUD127"]
    assert unborne(np.where((T > 2) & (T < 2.35), 3.0, 1.0)) == ["AUD123"]
