"""A few frames measured alone are, bit for bit, those frames of all of them."""

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.episode import Geom
from safestage_eval.evidence.measure import Signals
from safestage_eval.evidence.reference import Baseline, Reference, latest
from safestage_eval.signals import SIGNALS

FRAMES = 60
BALL = Geom(kind="sphere", size=(0.05,))


def scene(com: tuple[float, float, float], up_axis: tuple[float, float, float] | None):
    rng = np.random.default_rng(3)
    path, turn = rng.normal(size=(FRAMES, 3)), rng.normal(size=(FRAMES, 4))
    turn /= np.linalg.norm(turn, axis=1)[:, None]
    made = Scene(FRAMES).body("a", BALL, path, turn, com=com, up_axis=up_axis)
    return made.fixed("table").episode()


@pytest.mark.parametrize("com", [(0.0, 0.0, 0.0), (0.1, -0.2, 0.3)])
@pytest.mark.parametrize("events", [None, [], [0], [20], [20, 45]])
def test_it_is_a_part_of_the_whole(com, events) -> None:
    episode = scene(com, (0.0, 0.0, 1.0))
    reference = None
    if events is not None:
        since = latest(np.array(events, np.int64), FRAMES)
        reference = Reference(Baseline(5), since, f"{events}")
    whole = Signals(episode)
    for name in (name for name, signal in SIGNALS.items() if signal.stretch):
        every = whole.get(name, ("a",), reference)
        for first, stop in ((0, 1), (10, 19), (25, 40), (46, 60), (59, 60)):
            for signals in (Signals(episode), whole):
                found = signals.stretch(name, ("a",), reference, (), slice(first, stop))
                assert found is not None
                assert found.dimension == every.dimension
                assert found.notes == every.notes
                for part, full in ((found.lower, every.lower), (found.upper, every.upper)):
                    assert part.tobytes() == full[first:stop].tobytes(), (name, first, stop)


def test_frames_that_look_back_to_different_moments_are_not_measured_alone() -> None:
    signals = Signals(scene((0.0, 0.0, 0.0), None))
    reference = Reference(Baseline(5), latest(np.array([20]), FRAMES), "20")
    assert signals.stretch("turn", ("a",), reference, (), slice(15, 25)) is None
    assert signals.stretch("displacement", ("a",), reference, (), slice(15, 25)) is None


def test_what_depends_on_more_is_not_measured_alone() -> None:
    signals = Signals(scene((0.0, 0.0, 0.0), None))
    here = slice(5, 10)
    assert signals.stretch("tilt", ("a",), None, (), here) is None  # it has no up axis
    assert signals.stretch("speed", ("a",), None, (), here) is None
    assert signals.stretch("displacement", ("a",), None, (("norm", "l1"),), here) is None
