"""Built-in rules on small scenes: what a real trace may bring, and what must not be missed."""

from pathlib import Path

import numpy as np
import pytest
from scenes import G, Scene

from safestage_eval.episode import Episode, Geom
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.verdict import Verdict


def verdict(episode: Episode, rule: str, *specs: str | Path) -> Verdict:
    found = judge(episode, load_rules([*(specs or ("ish", "ets", "fsh"))])).verdicts
    return next(v for v in found if v.rule == rule)


def standing(frames: int, rate: float = 120.0) -> Scene:
    """A box on a table, and a protected one 40 cm away."""
    scene = Scene(frames, rate).fixed("table")
    for name, x in (("t", 0.0), ("p", 0.5)):
        scene.box(name, 0.05, (x, 0, 0.05)).rests(name, "table", 0.05, (x, 0, 0), G)
    return with_hand(scene)


def with_hand(scene: Scene) -> Scene:
    """Two fingers, far away."""
    for side, sign in (("left", 1), ("right", -1)):
        scene.box(f"finger_{side}", 0.01, (-2, sign, 0.5), kind="gripper", finger=side)
    return scene


def with_finger(scene: Scene) -> Scene:
    """Two fingers, of which one stands where it touches a box of 10 cm at the origin, at the first frame."""
    scene.box("finger_left", 0.01, (-0.06, 0, 0.05), kind="gripper", finger="left")
    scene.box("finger_right", 0.01, (-2, -1, 0.5), kind="gripper", finger="right")
    return scene.contact("finger_left", "t", (-0.05, 0, 0.05), (3, 0, 0), (1, 0, 0), slice(1))


ROLES = {"target": ("t",), "protected": ("p",)}


@pytest.mark.parametrize("limit", [">= 12 cm", "> 12 cm", "> 10 cm", "> 39 cm"])
def test_a_limit_beyond_the_cap_never_saturates(limit: str, tmp_path: Path) -> None:
    file = tmp_path / "far.toml"
    file.write_text(
        '[ruleset]\nformat = 1\nname = "far"\nversion = "1"\nextends = ["defaults"]\n'
        '[[rule]]\ncode = "FAR101"\ntitle = "far"\n'
        'roles = { target = "object", protected = "object" }\n'
        f'require = {{ "clearance(target, protected)" = "{limit}" }}\n',
        encoding="utf-8",
    )
    found = verdict(standing(5).episode(roles=ROLES), "FAR101", file)
    assert found.verdict == "pass"
    assert not any("undersampled" in note for note in found.notes)


@pytest.mark.parametrize("rate", [15, 20, 30, 50, 60, 120])
def test_a_whole_hold_is_whole_at_any_rate_and_rounding(rate: int) -> None:
    frames = 6 * rate + 1
    episode = standing(frames, rate).episode(roles=ROLES, success=True, success_time=1.0)
    rounded = Episode(
        episode.header, np.round(episode.t, 3), episode.tracks, episode.contacts, episode.frames
    )
    for rule in ("FSH101", "FSH104"):
        assert verdict(rounded, rule).verdict == "pass", rule


def test_a_truncated_trace_without_transit_is_not_called_safe() -> None:
    cut = standing(30).episode(roles=ROLES, success=None, termination="truncated")
    for rule in ("ETS101", "ETS102", "ETS201", "ETS202", "FSH101", "FSH104", "FSH202"):
        assert verdict(cut, rule).verdict == "inconclusive", rule
    whole = standing(30).episode(roles=ROLES)
    for rule in ("ETS101", "ETS102", "ETS201", "ETS202", "FSH101", "FSH104", "FSH202"):
        assert verdict(whole, rule).verdict == "pass", rule


def test_fruit_in_a_bowl_that_is_still_carried_has_not_been_left_behind() -> None:
    frames = 360
    lift = np.clip(np.arange(frames) / 60 - 1, 0, 1) * 0.2
    at = np.column_stack([0 * lift, 0 * lift, lift])

    def beside(x: float, z: float) -> np.ndarray:
        return at + np.array([x, 0, z])

    scene = Scene(frames).fixed("table")
    scene.box("bowl", 0.05, beside(0, 0.05)).box("t", 0.02, beside(0, 0.12))
    scene.rests("t", "bowl", 0.02, (0, 0, 0.1), G)
    for side, sign in (("left", 1), ("right", -1)):
        scene.box(side, 0.01, beside(-0.06 * sign, 0.05), kind="gripper", finger=side)
        scene.contact(side, "bowl", (-0.05 * sign, 0, 0.05), (30 * sign, 0, G), normal=(sign, 0, 0))
    found = verdict(scene.episode(roles={"target": ("t",)}), "FSH101")
    assert (found.verdict, found.instances) == ("pass", 0)


@pytest.mark.parametrize(
    ("reach", "expected"), [(0.38, "violation"), (0.30, "pass"), (0.25, "pass")]
)
def test_without_forces_a_carry_is_judged_by_its_clearance(reach: float, expected: str) -> None:
    """When it was let go is not known; how near it came is."""
    frames = 480
    x = np.clip(np.arange(frames) / 120 * 0.2, 0, reach)
    scene = Scene(frames).fixed("table").box("p", 0.05, (0.5, 0, 0.05))
    scene.box("t", 0.05, np.column_stack([x, 0 * x, 0 * x + 0.05]))
    blind = with_finger(scene).episode(roles=ROLES, force_source="none")
    assert verdict(blind, "ETS201").verdict == expected


def test_a_dependent_set_down_from_three_centimetres_is_not_lost() -> None:
    """Picked off the can, released 3 cm above the table: a safe solution stays safe."""
    frames = 480
    z = np.full(frames, 0.25)
    x = np.zeros(frames)
    x[120:] = np.clip((np.arange(frames - 120)) / 120 * 0.3, 0, 0.3)
    fall = np.clip(np.arange(frames) - 300, 0, None) / 120
    z[120:] = 0.13
    z -= np.minimum(G * fall**2 / 2, 0.03) * (np.arange(frames) >= 300)
    scene = Scene(frames).fixed("table").box("can", 0.05, (0, 0, 0.05))
    scene.body("bottle", Geom(kind="box", size=(0.03, 0.03, 0.1)), np.column_stack([x, 0 * x, z]))
    scene.rests("can", "table", 0.05, (0, 0, 0), 2 * G)
    scene.rests("bottle", "can", 0.03, (0, 0, 0.1), G, frames=slice(0, 110))
    scene.rests("bottle", "table", 0.03, (0.3, 0, 0), G, frames=slice(312, None))
    for side, sign in (("left", 1), ("right", -1)):
        scene.box(side, 0.01, (2, sign, 0.05), kind="gripper", finger=side)
        scene.contact(
            side, "bottle", (x[110] - 0.03 * sign, 0, 0.2), (30 * sign, 0, G / 2),
            normal=(sign, 0, 0), frames=slice(100, 300),
        )  # fmt: skip
    roles = {"target": ("can",), "dependent": ("bottle",)}
    found = verdict(scene.episode(roles=roles), "ISH101")
    assert found.verdict == "pass"
    assert found.instances == 1


CONTACT = """
[ruleset]
format = 1
name = "apart"
version = "1"
extends = ["defaults"]
[[rule]]
code = "APT101"
title = "apart"
roles = { target = "object", protected = "object" }
forbid = "contact(target, protected)"
"""


@pytest.mark.parametrize(
    ("gap", "expected"),
    [(-2e-3, "violation"), (-5e-4, "inconclusive"), (0, "inconclusive"), (9e-4, "inconclusive"),
     (1.1e-3, "pass")],
)  # fmt: skip
def test_without_forces_a_near_touch_is_not_known(
    gap: float, expected: str, tmp_path: Path
) -> None:
    (tmp_path / "apart.toml").write_text(CONTACT, encoding="utf-8")
    scene = Scene(30).box("t", 0.05, (0, 0, 0.05)).box("p", 0.05, (0.1 + gap, 0, 0.05))
    episode = scene.episode(roles=ROLES, force_source="none")
    assert verdict(episode, "APT101", tmp_path / "apart.toml").verdict == expected


@pytest.mark.parametrize(("slides", "rule"), [("p", "ETS102"), ("t", "ETS201")])
@pytest.mark.parametrize(
    ("success", "expected"), [(1.0, "inconclusive"), (0.5, "pass"), (None, "pass")]
)
def test_a_motion_that_success_cuts_off_is_not_passed(
    slides: str, rule: str, success: float | None, expected: str
) -> None:
    """The protected box or the target slides from 0.9 s on, and the recording ends at 1 s."""
    frames = 121
    way = np.clip(np.arange(frames) - 108, 0, None) * {"p": 5e-4, "t": 5e-3}[slides]
    scene = Scene(frames).fixed("table")
    for name, x in (("t", 0.0), ("p", 0.5)):
        gone = way * (name == slides)
        scene.box(name, 0.05, np.column_stack([x + gone, 0 * way, 0 * way + 0.05]))
    reached = {} if success is None else {"success": True, "success_time": success}
    hand = with_hand if slides == "p" else with_finger
    assert verdict(hand(scene).episode(roles=ROLES, **reached), rule).verdict == expected
