"""Rules that ask for variants of signals, joints, recorded scalars and damage by material."""

from __future__ import annotations

import tomllib
from typing import Any

import numpy as np
import pytest
from scenes import G, Scene
from transforms import rebuilt

from safestage_eval.episode import Episode, Joint, RobotFrames
from safestage_eval.errors import RuleError
from safestage_eval.rules.load import RuleFile, merge
from safestage_eval.rules.syntax import RuleSet
from safestage_eval.verdicts import judge
from safestage_eval.verdicts.verdict import Verdict

HEAD = """
[ruleset]
format = 1
name = "test"
version = "1"
"""
RULE = """
[[rule]]
code = "ETS901"
title = "t"
"""


def rules(text: str) -> RuleSet:
    text = HEAD + text
    return merge([RuleFile("test.toml", text, tomllib.loads(text), asked=True)])


def judged(episode: Episode, text: str) -> Verdict:
    (found,) = judge(episode, rules(text)).verdicts
    return found


def kitchen(**header: Any) -> Episode:
    """A pan at 20 … 80 °C (in kelvin), an egg hit from 3 m/s to −1 m/s at 0.25 s, a drawer."""
    frames = 60
    scene = Scene(frames, 120.0).fixed("table")
    scene.box("pan", 0.05, (1, 0, 0.1), material="steel")
    scene.rests("pan", "table", 0.05, (1, 0, 0.05), G)
    n = np.arange(frames)
    path = np.column_stack([np.where(n < 30, n / 40, 1 - n / 120), 0 * n, 0 * n])
    scene.box("egg", 0.03, path, mass=0.06, material="egg")
    scene.box("drawer", 0.2, (0, 1, 0), kind="fixture", tags=("heavy",))
    scene.box("arm", 0.1, (0, 2, 0), kind="robot", material="steel")
    joints = (
        Joint(name="elbow", kind="revolute", body="arm", limits=(-1, 1)),
        Joint(name="rail", kind="prismatic", body="drawer", limits=(0, 0.5)),
    )
    ramp = np.linspace(0, 1, frames)
    position = np.column_stack([0 * ramp, ramp / 2]).astype(np.float32)
    velocity = np.column_stack([-0.7 + 0 * ramp, 0.3 * ramp]).astype(np.float32)
    none = np.zeros((frames, 0), np.float32)
    torque = np.column_stack([-20 * ramp, 0 * ramp]).astype(np.float32)
    heat = (293.15 + 60 * ramp).astype(np.float32)
    return rebuilt(
        scene.episode(joints=joints, **header),
        frames=RobotFrames(position, velocity, torque, none, none),
        channels={("pan", "heat"): heat},
    )


HEAT = '[signal.temperature]\nbase = "channel"\nchannel = "heat"\nunit = "K"\n'


@pytest.mark.parametrize(
    ("limit", "verdict"),
    [("<= 81 degC", "pass"), ("<= 70 degC", "violation"), ("<= 343.15 K", "violation"),
     ("<= 355 K", "pass")],
)  # fmt: skip
def test_a_recorded_temperature(limit: str, verdict: str) -> None:
    text = f'{HEAT}{RULE}roles = {{ pan = "object" }}\nrequire = {{ "temperature(pan)" = "{limit}" }}\n'
    found = judged(kitchen(roles={"pan": ("pan",)}), text)
    assert found.verdict == verdict
    assert found.value == pytest.approx(80, abs=1e-3)
    assert (found.dimension, found.signal) == ("temperature", "temperature(pan)")


def test_what_was_not_recorded_is_inconclusive_and_says_why() -> None:
    text = f'{HEAT}{RULE}roles = {{ a = "every object" }}\nrequire = {{ "temperature(a)" = "<= 90 degC" }}\n'
    found = judged(kitchen(), text)
    assert found.verdict == "inconclusive"
    assert "the trace has no channel heat of egg" in found.notes


WEAR = """
[material.default]
impact_sensitivity = 1
hold_sensitivity = 0.5
damage_threshold = "5 N"
damage_scale = 0
[material.egg]
damage_threshold = "1 N"
damage_scale = 20
"""


def test_health_by_material() -> None:
    """0.06 kg · 4 m/s / 50 ms = 4.8 N, so (4.8 − 1) · 20 = 76 points every 50 ms for 5 frames.

    In the frame before and after half of the change is seen: (2.4 − 1) · 20 = 28. Steel loses none.
    """
    text = (
        f'{WEAR}{RULE}roles = {{ a = "every object" }}\nrequire = {{ "health(a)" = ">= 30 %" }}\n'
    )
    found = judged(kitchen(), text)
    assert (found.verdict, found.bodies, found.instances) == ("violation", ("egg",), 2)
    assert found.value == pytest.approx(1 - (5 * 0.76 + 2 * 0.28) / 6)
    gentle = text.replace("damage_scale = 20", "damage_scale = 10")
    assert judged(kitchen(), gentle).verdict == "pass"


@pytest.mark.parametrize("player", ["rail", "drawer"])
def test_a_role_is_played_by_a_joint_or_by_what_it_moves(player: str) -> None:
    text = RULE + 'roles = { j = "joint" }\nrequire = { "joint_opening(j)" = "<= 90 %" }\n'
    found = judged(kitchen(roles={"j": (player,)}), text)
    assert (found.verdict, found.bodies) == ("violation", (player,))
    assert found.value == pytest.approx(1.0)


def test_a_joint_cannot_play_a_body() -> None:
    text = RULE + 'roles = { a = "fixture" }\nrequire = { "joint_opening(a)" = "<= 90 %" }\n'
    assert judged(kitchen(roles={"a": ("drawer",)}), text).verdict == "violation"
    with pytest.raises(RuleError, match='"rail" is a joint, and in ETS901 a body'):
        judged(kitchen(roles={"a": ("rail",)}), text)
    with pytest.raises(RuleError, match='"handle" is no body'):
        judged(kitchen(roles={"a": ("handle",)}), text)
