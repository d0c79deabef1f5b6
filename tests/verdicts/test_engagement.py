"""How far a rollout got with its target, on scenes in which that is plain to see."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.episode import Episode
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import EpisodeResult, judge

FRAMES = 240
SIDES = {"left": (0, 1, 0), "right": (0, -1, 0)}


def played(
    near: float = 0.3,
    touch: slice | np.ndarray | None = None,
    lift: tuple[int, int] | None = None,
    *,
    carrier: bool = False,
    **header: Any,
) -> Episode:
    """Two fingers come as near to a can as told, touch it from frame to frame, and lift it.

    ``lift``: from this frame on the can rises by 10 cm, until that frame. ``carrier``: the fingers
    hold a tray on which the can stands, not the can.
    """
    scene = Scene(FRAMES).fixed("table")
    height = np.zeros(FRAMES)
    if lift is not None:
        height = np.clip((np.arange(FRAMES) - lift[0]) / (lift[1] - lift[0]), 0, 1) * 0.1
    can = np.stack([np.zeros(FRAMES), np.zeros(FRAMES), 0.05 + height], axis=1)
    if carrier:
        scene.box("tray", (0.2, 0.2, 0.005), can - [0, 0, 0.045])
        scene.contact("tray", "can", [(0, 0, 0)], (0, 0, 9.81))
    gap = np.interp(np.arange(FRAMES), (0, 80), (0.3, near))[:, None]
    for name, side in SIDES.items():
        path = can + np.array(side) * (0.05 + gap)
        scene.box(f"{name}_finger", 0.02, path, kind="gripper", finger=name)
        if touch is not None:
            held = "tray" if carrier else "can"
            inward = -np.array(side, float)
            scene.contact(f"{name}_finger", held, [(0, 0, 0.05)], 5 * inward, inward, touch)
    scene.box("can", 0.03, can)
    roles = header.pop("roles", {"target": ("can",)})
    return scene.episode(roles=roles, task="lift", **header)


def found(episode: Episode, rules: str = "fsh") -> EpisodeResult:
    return judge(episode, load_rules([rules]))


@pytest.mark.parametrize(
    ("stage", "told"),
    [
        ("idle", {"near": 0.2}),
        ("idle", {"near": 0.055}),
        ("reached", {"near": 0.045}),
        ("touched", {"near": 0.0, "touch": slice(100, 150)}),
        ("manipulated", {"near": 0.0, "touch": slice(100, None), "lift": (120, 160)}),
        ("released", {"near": 0.0, "touch": slice(100, 200), "lift": (120, 160)}),
        ("success", {"success": True, "success_time": 1.0}),
    ],
)
def test_the_ladder(stage: str, told: dict[str, Any]) -> None:
    result = found(played(**told))
    assert result.engagement == stage
    assert {row["engagement"] for row in result.rows()} == {stage}


def test_a_grip_that_is_adjusted_lets_nothing_go() -> None:
    episode = played(0.0, slice(100, None), (120, 160))
    gone = (episode.contacts.frame >= 200) & (episode.contacts.frame < 206)  # 50 ms
    rest = episode.contacts.where(~gone)
    made = Episode(episode.header, episode.t, episode.tracks, rest, episode.frames)
    assert found(made).engagement == "manipulated"


def test_what_the_robot_carries_on_a_tray_is_manipulated() -> None:
    taken = played(0.2, slice(100, None), (120, 160), carrier=True)
    assert found(taken).engagement == "manipulated"


@pytest.mark.parametrize(
    ("touch", "goal", "noted"),
    [
        (np.r_[81:96, 119:FRAMES], "on", True),  # success by a moment's release
        (slice(80, None), "on", False),  # never let go
        (slice(80, 200), "on", False),  # let go in the last second
        (slice(80, None), None, False),  # a success that may be to hold
    ],
)
def test_a_target_that_is_gripped_at_the_end_is_noted(
    touch: slice | np.ndarray, goal: str | None, noted: bool
) -> None:
    roles = {"target": ("can",), "destination": ("table",)}
    episode = played(0.0, touch, roles=roles, goal=goal, success=True, success_time=0.5)
    result = judge(episode, load_rules(["fsh", "goals"]))
    assert any("held again" in note for note in result.notes) is noted
