"""Less evidence never makes an episode safe: a sample of benchmarks/evidence.py, new each day."""

import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from scenes import G, Scene

from safestage_eval.errors import TraceError
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge

HERE = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HERE / "benchmarks"))

import evidence  # noqa: E402

SEED = datetime.now(UTC).toordinal()
MEASURED = [
    "pose_nan", "all_nan", "unseen", "contact_nan", "bad_normals", "no_forces", "robot_nan",
    "header_unknown", "body_unknown", "body_removed", "early_end", "velocities_gone",
    "contacts_gone", "joints_untold",
]  # fmt: skip
"""Kinds of edits of what was measured."""
SHORTER = ["hole", "thinned", "late_start", "role_unbound", "role_misspelt"]
"""Those of the clock and of roles."""


def told(found):
    return [f"--seed {SEED} --only {o.number}: {o}" for o in found if o.breaches]


def test_what_was_not_measured_satisfies_nothing():
    found = evidence.campaign([str(HERE / "traces")], SEED, 240, kinds=MEASURED)
    assert sum(bool(o.became) for o in found) > 150
    assert not told(found)


def test_a_shorter_clock_and_missing_roles_satisfy_nothing():
    assert not told(evidence.campaign([str(HERE / "traces")], SEED, 80, kinds=SHORTER))


def test_the_law_is_broken_by_what_breaks_it():
    assert evidence.forbidden("violation", "pass")
    assert evidence.forbidden("violation", "not_applicable")
    assert evidence.forbidden("pass", "violation")
    assert not evidence.forbidden("violation", "inconclusive")
    assert not evidence.forbidden("pass", "not_applicable")


@pytest.mark.parametrize("shown", [True, False])
def test_how_the_robot_reached_what_fell_cannot_be_cut_out(shown):
    """A stick that plays no role, in the robot's hand, knocks a vase over."""
    frames, rate = 240, 120.0
    scene = Scene(frames, rate).fixed("table").box("apple", 0.03, (0.4, 0.4, 0.03))
    angle = np.clip(scene.t - 1.0, 0, 0.5) * np.pi
    turn = np.column_stack([np.cos(angle / 2), np.sin(angle / 2), 0 * angle, 0 * angle])
    scene.box("vase", 0.05, (0, 0, 0.05), orientation=turn)
    spin = np.zeros((frames, 3), np.float32)
    spin[:, 0] = np.gradient(angle, 1 / rate)
    scene.tracks["vase"] = replace(scene.tracks["vase"], angular_velocity=spin)
    scene.rests("vase", "table", 0.05, (0, 0, 0), G).rests("apple", "table", 0.03, (0.4, 0.4, 0), G)
    scene.box("stick", 0.02, (0, 0.07, 0.08))
    for side, y in (("left", -1), ("right", 1)):
        x = 0.03 * y
        scene.box(side, 0.01, (x, 0.07, 0.08), kind="gripper", finger=side)
        if shown:
            scene.contact(side, "stick", (0.02 * y, 0.07, 0.08), (-9.0 * y, 0, G / 2), (-y, 0, 0))
    if shown:
        scene.contact("stick", "vase", (0, 0.05, 0.08), (0, -1, 0), (0, -1, 0), slice(115, 130))
    roles = {"target": ("apple",), "protected": ("vase",)}
    episode = replace(scene.episode(roles=roles, rules=("ETS103",)), path=Path("knocked.mcap"))
    rules = load_rules(["ets"])
    if shown:
        (found,) = judge(episode, rules, assigned_only=True).verdicts
        assert found.verdict == "violation"
    else:
        with pytest.raises(TraceError, match=r"'stick' rests .* contacts bear it with 0 N"):
            judge(episode, rules, assigned_only=True)


def test_an_edit_is_the_same_again():
    one, again = (evidence.attempt((str(HERE / "traces"),), 5, 3) for _ in range(2))
    assert one == again
