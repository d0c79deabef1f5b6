"""A change since an event that came between samples: the bounds hold it."""

import numpy as np
import pytest
from resampled import resampled
from sketched import drawn, verdict

KNOCKED = """
says     = "A finger pushes a vase over: the vase leans, then falls, and the finger is gone."
duration = "5 s"
rate     = 120
success  = "4 s"
roles    = { target = "apple", protected = "vase" }
story    = [
  { touch = "vase", by = "finger_left", side = "-y", force = "2 N", during = "2 to 2.6 s" },
  { tip = "vase", toward = "+y", by = "10 deg", during = "2 to 2.3 s" },
  { tip = "vase", toward = "+y", by = "60 deg", during = "2.55 to 2.75 s" },
]
[bodies.apple]
shape = "sphere 7.6 cm"
at    = "-25, 0 cm"
[bodies.vase]
shape = "cylinder 7 x 12 cm"
at    = "0, 12 cm"
"""


@pytest.mark.parametrize("every", [8, 25, 49])
def test_what_fell_as_it_was_let_go_between_two_samples_is_no_pass(tmp_path, every) -> None:
    whole = drawn(KNOCKED, tmp_path)
    assert verdict(whole, "ETS103", forces=True).verdict == "violation"
    found = [
        verdict(resampled(whole, np.unique([0, *range(first, len(whole), every)])), "ETS103", True)
        for first in range(1, every, 4)
    ]
    assert {v.verdict for v in found} <= {"violation", "inconclusive"}
    open_ = [v.explanation for v in found if v.verdict == "inconclusive"]
    text = "turn(vase) since end of handled(vase) is not known: that came between two samples"
    assert any(text in why for why in open_) == (every > 8)  # 15 Hz show it
