"""A goal watched live, window by window, is reached at the frame at which the whole trace says so."""

from __future__ import annotations

import numpy as np
import pytest
from growing import growing
from scenes import Scene

from safestage_eval.episode import Episode
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.goal import GoalMonitor

STEP = 8
"""Frames between two looks, as many as a control step has."""


def let_go_in_pulses(seed: int, frames: int = 96) -> Episode:
    """A box rests on a plate; a fingertip touches it now and then, for a few frames each time."""
    rng = np.random.default_rng(seed)
    scene = Scene(frames).fixed("plate", kind="object")
    scene.box("box", 0.02, (0, 0, 0.02), mass=0.5)
    for side, x in (("left", -0.01), ("right", 0.01)):
        scene.box(f"{side}_finger", 0.005, (x, 0, 0.045), kind="gripper", finger=side)
    scene.rests("box", "plate", 0.02, (0, 0, 0), 0.5 * 9.81)
    frame = 0
    while frame < frames:
        touch = int(rng.choice([3, 3, 3, 4, 6]))
        scene.contact(
            "left_finger", "box", (0, 0, 0.04), (0, 0, -1.0), frames=slice(frame, frame + touch)
        )
        frame += touch + int(rng.choice([1, 4], p=[0.9, 0.1]))
    return scene.episode(
        goal="on",
        roles={"target": ("box",), "destination": ("plate",)},
        success=None,
        termination="truncated",
    )


def live(episode: Episode) -> float | None:
    """The time of success, for a recorder that looks every ``STEP`` frames."""
    monitor, recording = GoalMonitor.of(episode.header), growing(episode)
    assert monitor.window_frames is not None
    for now in range(STEP, len(episode) + 1, STEP):
        recording.frames = now
        first = max(0, now - STEP - monitor.window_frames)
        found = monitor.update(recording.window(first, now), STEP)
        if found is not None:
            return found
    return None


@pytest.mark.parametrize("seed", range(12))
def test_live_and_whole_agree(seed: int) -> None:
    episode = let_go_in_pulses(seed)
    assert live(episode) == judge(episode, load_rules(["goals"])).success_time


def test_some_are_reached_late_and_some_never() -> None:
    times = [live(let_go_in_pulses(seed)) for seed in range(12)]
    assert None in times
    assert any(time is not None and time > STEP / 120 for time in times)
