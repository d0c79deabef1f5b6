"""Frames in the stretches that were not recorded."""

import numpy as np
from resampled import resampled
from scenes import Scene

from safestage_eval.episode import with_holes


def test_a_hole_is_filled_beside_frames_that_are_unseen_already() -> None:
    whole = Scene(120).box("a", 0.01, (0, 0, 0)).episode()
    seen = resampled(whole, np.flatnonzero((whole.t < 0.3) | (whole.t > 0.7)))
    lost = np.zeros(len(seen), np.bool_)
    lost[-3:] = True
    object.__setattr__(seen, "unseen", lost)
    view = with_holes(seen)
    assert view.unseen is not None
    assert view.t[view.unseen].round(3).tolist() == [0.3, 0.975, 0.983, 0.992]
    assert with_holes(view) is view
    assert view.recorded is seen
