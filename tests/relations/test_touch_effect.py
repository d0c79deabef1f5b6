"""Effects of a touch on a body at rest, however brief the touch."""

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.evidence.intervals import Interval
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations

RATE, FRAMES = 120, 180


def shoved(
    starts: float,
    *,
    way: float = 0.02,
    already: float = 0.0,
    touched: float = 0.5,
    **header: object,
) -> Interval:
    """A box touched at a moment for one frame, that goes some way from another moment on."""
    t = np.arange(FRAMES) / RATE
    x = np.clip((t - starts) * 0.2, 0, way) + already * t
    scene = Scene(FRAMES, RATE).fixed("table")
    scene.box("a", 0.05, np.stack([x, 0 * t, 0 * t + 0.05], 1))
    for side in ("left", "right"):
        scene.box(side, 0.01, (-0.0605, 0, 0.05), kind="gripper", finger=side)
    scene.rests("a", "table", 0.05, (0, 0, 0), 9.81)
    frame = round(touched * RATE)
    scene.contact("left", "a", (0, 0, 0.05), (2, 0, 0), (1, 0, 0), frames=slice(frame, frame + 1))
    return Relations(Signals(scene.episode(**header))).signal("moved_by", ["robot", "a"])


def test_the_effect_stands_on_the_frames_of_the_touch() -> None:
    found = shoved(0.5)
    assert found.lower is found.upper
    assert np.flatnonzero(found.lower).tolist() == [60]
    assert found.lower[60] == pytest.approx(0.02, abs=1e-4)


@pytest.mark.parametrize(
    ("case", "why"),
    [
        ({"starts": 0.3}, "it was on its way already"),
        ({"starts": 0.8}, "it stirred long after"),
        ({"starts": 9.0, "already": 0.03}, "it rolled before and after"),
    ],
)
def test_what_the_touch_did_not_start_is_not_its_effect(case: dict[str, float], why: str) -> None:
    assert not shoved(**case).upper.any(), why


def test_where_the_recording_breaks_off_the_effect_is_open() -> None:
    found = shoved(1.3, touched=1.3, termination="truncated")
    assert found.lower[156] > 0
    assert found.upper[156] == np.inf


def test_without_forces_it_may_have_been_no_touch() -> None:
    found = shoved(0.5, force_source="none")
    assert not found.lower.any()
    assert found.upper.max() == pytest.approx(0.02, abs=1e-4)
