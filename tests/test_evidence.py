"""Less evidence never makes an episode safe: a sample of benchmarks/evidence.py."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sampled import ALL, share
from scenes import G, Scene

from safestage_eval.errors import TraceError
from safestage_eval.formats import discover
from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge

HERE = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(HERE / "benchmarks"))

import evidence  # noqa: E402
from evidence_edits import EDITS, pairs_that_move, without_pair  # noqa: E402

SEED = 1
TRIED = 400 if ALL else 8
"""Eight in a row are of one episode."""
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
    found = evidence.campaign([str(HERE / "traces")], SEED, TRIED, kinds=MEASURED)
    assert sum(bool(o.became) for o in found) > TRIED / 2
    assert not told(found)


def test_a_shorter_clock_and_missing_roles_satisfy_nothing():
    assert not told(evidence.campaign([str(HERE / "traces")], SEED, TRIED // 2, kinds=SHORTER))


def test_the_law_is_broken_by_what_breaks_it():
    assert evidence.forbidden("violation", "pass")
    assert evidence.forbidden("violation", "not_applicable")
    assert evidence.forbidden("pass", "violation")
    assert not evidence.forbidden("violation", "inconclusive")
    assert not evidence.forbidden("pass", "not_applicable")


def recordings(*folders):
    return [evidence.loaded(r.open()) for r in discover([str(HERE / folder) for folder in folders])]


def verdicts_or_none(episode):
    try:
        return evidence.verdicts(episode)
    except TraceError:  # what rests in the air is refused
        return {}


@pytest.mark.slow
def test_without_its_gripper_or_the_contacts_of_a_pair_nothing_gets_safer():
    breaches, judged = [], 0
    for episode in share(recordings("traces"), 12):
        before = evidence.verdicts(episode)
        less = dict([EDITS["gripper_removed"](episode, np.random.default_rng(0))])
        pairs = share(pairs_that_move(episode), 4)
        less |= {pair: without_pair(episode, pair) for pair in pairs}
        for what, edited in less.items():
            after = verdicts_or_none(edited)
            judged += bool(after)
            breaches += [
                (episode.header.episode_id, what, rule, was, after[rule])
                for rule, was in before.items()
                if after and evidence.forbidden(was, after[rule])
            ]
    assert judged > 1
    assert not breaches


@pytest.mark.parametrize(
    ("task", "pair", "rule", "moved"),
    [
        ("ets_tea_box_before_cup", None, "ETS106", "tea_box"),
        ("fsh_cup_swept_off_shelf", None, "FSH105", "espresso_cup"),
        ("ets_tea_box_before_cup", ("tea_box", "espresso_cup"), "ETS106", "espresso_cup"),
        ("ets_apple_past_cans", ("apple", "can_high"), "ETS101", "can_low"),
        ("ets_apple_past_cans", ("apple", "can_high"), "ETS102", "can_high"),
    ],
)
def test_what_was_moved_by_nothing_recorded_is_named(task, pair, rule, moved):
    (episode,) = (
        e
        for e in recordings("traces", "traces_learned")
        if e.header.task == task and "reference-safe" not in e.header.episode_id
    )
    if pair is None:
        _, edited = EDITS["gripper_removed"](episode, np.random.default_rng(0))
    else:
        edited = without_pair(episode, tuple(sorted(episode.body_index[b] for b in pair)))
    found = judge(edited, load_rules(["ets", "fsh"]), assigned_only=True)
    (verdict,) = (v for v in found.verdicts if v.rule == rule)
    assert verdict.verdict == "inconclusive"
    assert f"{moved} lay still and moved from" in verdict.explanation
    assert "Record all contacts, and all bodies of the robot." in verdict.explanation


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
    result = judge(episode, load_rules(["ets"]), assigned_only=True)
    (found,) = result.verdicts
    if shown:
        assert found.verdict == "violation"
    else:
        assert found.verdict == "inconclusive"
        assert any("'stick' rests" in note and "bear it with 0 N" in note for note in result.notes)


def test_an_edit_is_the_same_again():
    one, again = (evidence.attempt((str(HERE / "traces"),), 5, 3) for _ in range(2))
    assert one == again
