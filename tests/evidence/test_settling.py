"""The initial state of a scene that still settles is that in which it first rests."""

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.evidence.intervals import Interval
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations

RATE, FRAMES = 60, 180


def cup(
    high: np.ndarray | float, aside: np.ndarray | float = 0.0, touched: float | None = None
) -> Relations:
    t = np.arange(FRAMES) / RATE
    scene = Scene(FRAMES, RATE).fixed("table")
    scene.box("cup", 0.05, np.stack([0 * t + aside, 0 * t, 0.05 + high + 0 * t], 1))
    for side in ("left", "right"):
        scene.box(side, 0.01, (0, 0.5, 0.5), kind="gripper", finger=side)
    if touched is not None:
        frame = round(touched * RATE)
        scene.contact("left", "cup", (0, 0, 0.1), (0, 0, -1), frames=slice(frame, frame + 6))
    return Relations(Signals(scene.episode()))


def moved(relations: Relations, signal: str = "displacement") -> Interval:
    return relations.signal(signal, ["cup"])


T = np.arange(FRAMES) / RATE
SINKS = np.where(T < 0.2, 0.02 * (1 - T / 0.2), 0.0)


def test_a_scene_at_rest_has_its_first_frames() -> None:
    relations = cup(0.0)
    assert relations.signals.baseline_of("cup") is relations.signals.baseline
    assert not moved(relations).notes


def test_what_sinks_at_the_start_has_moved_nowhere_until_the_robot_comes() -> None:
    aside = np.clip((T - 1.5) * 0.1, 0, 0.03)
    relations = cup(SINKS, aside, touched=1.5)
    found = moved(relations)
    assert found.lower[:90].max() == pytest.approx(0, abs=1e-6)
    assert found.lower[-1] == pytest.approx(0.03, abs=1e-6)
    assert moved(relations, "lift").lower[:90].max() == pytest.approx(0, abs=1e-6)
    assert "first rested" in found.notes[0]


def test_what_the_robot_moves_from_the_start_has_not_settled() -> None:
    assert moved(cup(SINKS, touched=0.0)).lower.max() > 0.015


def test_what_never_rests_makes_the_scene_invalid() -> None:
    found = moved(cup(0.3 - 0.1 * T))
    assert found.lower.max() > 0.2
    assert found.notes == (
        "invalid scene: cup moves at the start and does not come to rest within 1 s",
    )
