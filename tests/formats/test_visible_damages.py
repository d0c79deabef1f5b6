"""A recording that shows that it is damaged is never called safe, though all its hashes are right.

Each damage is put into a golden recording, which is then written anew: content hash and digests are
those of the damaged data. What comes of it is a listed problem, or an inconclusive verdict that says
why. The words are what a user has to find in the message.
"""

from functools import cache
from pathlib import Path

import damages as d
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from safestage_eval.doubts import contradictions
from safestage_eval.doubts.doubtful_columns import doubtful_columns
from safestage_eval.formats import discover, validate_episode
from safestage_eval.formats.parquet.dataset_writer import add_episode
from safestage_eval.rules import builtin_names, load_rules
from safestage_eval.run.score_episode import score_episode
from safestage_eval.verdicts.problem import Problem
from safestage_eval.whatif.judge_again import Again

TRACES = Path(__file__).parents[2] / "traces"

SHELF, CANS, GLASSES, BIN, CAN = (
    ("fsh_bottle_on_shelf.reference-safe", "bottle"),
    ("ets_apple_past_cans.reference-safe", "can_high"),
    ("ets_dumbbell_near_glasses.reference-safe", "glasses"),
    ("ish_bin_with_lemon.reference-safe", "small_bin"),
    ("ish_coffee_can_under_bottle.reference-safe", "coffee_can"),
)
"""Recordings that pass, and the body that is damaged: targets, and what is protected."""

POSITION, LINEAR = "position", "linear_velocity"

DAMAGES = {
    # units of poses
    "target in centimetres": (SHELF, d.track(position=d.scaled(100)), "look for"),
    "target in millimetres": (CAN, d.track(position=d.scaled(1000)), "look for"),
    "target in inches": (BIN, d.track(position=d.scaled(39.37)), "look for"),
    "obstacle in centimetres": (CANS, d.track(position=d.scaled(100)), "another unit"),
    "protected in decimetres": (GLASSES, d.track(position=d.scaled(10)), "another unit"),
    "target in km": (SHELF, d.track(position=d.scaled(1e-3)), "look for"),
    "target and its velocity in cm": (
        SHELF, d.track(position=d.scaled(100), linear_velocity=d.scaled(100)), "look for",
    ),
    "all poses in centimetres": (SHELF, d.track("*", position=d.scaled(100)), "velocity"),
    "all poses and velocities in centimetres": (
        SHELF, d.track("*", position=d.scaled(100), linear_velocity=d.scaled(100)), "look for",
    ),
    # axes and places
    "target turned about the world's z": (SHELF, d.track(position=d.turned(d.TURN_90)), "look for"),
    "target mirrored": (
        BIN, d.track(position=lambda p: p * np.float32([-1, 1, 1])), "look for",
    ),
    "y up, of all": (
        SHELF,
        d.track("*", position=d.turned(d.Y_UP), linear_velocity=d.turned(d.Y_UP)),
        "look for",
    ),
    "target 30 cm too high": (SHELF, d.track(position=lambda p: p + np.float32([0, 0, .3])), "surface"),
    "target below the floor": (
        CAN, d.track(position=lambda p: p - np.float32([0, 0, 2])), "look for",
    ),
    "obstacle 1 m aside": (CANS, d.track(position=lambda p: p + np.float32([0, 1, 0])), "look for"),
    # jumps
    "target teleports": (
        SHELF, d.track(position=d.from_then_on(.5, lambda p: p + np.float32([1, 0, 0]))), "jumps",
    ),
    "target is elsewhere in one frame": (
        SHELF, d.track(position=d.at_one_frame(.4, lambda p: p + np.float32([0, .5, 0]))), "jumps",
    ),
    "target's quaternions change their order": (
        SHELF, d.track(orientation=d.from_then_on(.5, d.xyzw)), "jumps",
    ),
    "obstacle teleports": (
        CANS, d.track(position=d.from_then_on(.6, lambda p: p + np.float32([0, 0, 5]))), "jumps",
    ),
    "pose frozen": (SHELF, d.track(position=lambda p: np.repeat(p[:1], len(p), 0)), "velocity"),
    "poses late by a second": (SHELF, d.track(position=lambda p: np.roll(p, 120, 0)), "look for"),
    # quaternions
    "all in xyzw": (CAN, d.track("*", orientation=d.xyzw), "xyzw"),
    "quaternions of norm 2": (SHELF, d.track(orientation=d.scaled(2)), "norm 2"),
    "quaternions of zeros": (SHELF, d.track(orientation=d.scaled(0)), "norm 0"),
    # velocities
    "velocity mirrored": (SHELF, d.track(linear_velocity=d.scaled(-1)), "velocity"),
    "velocity ten times": (SHELF, d.track(linear_velocity=d.scaled(10)), "ratio 10"),
    "velocity a tenth": (SHELF, d.track(linear_velocity=d.scaled(.1)), "ratio 0.1"),
    "velocity in other axes": (SHELF, d.track(linear_velocity=d.turned(d.TURN_90)), "velocity"),
    "velocity of another body": (
        SHELF, d.exchanged(LINEAR, other="robot_link3"), "velocity",
    ),
    # clock
    "stamps in milliseconds": (SHELF, d.clock(lambda t: t * 1000), "frame_dt"),
    "stamps and frame_dt in milliseconds": (
        SHELF, d.both(d.clock(lambda t: t * 1000), d.header(frame_dt=25 / 3)), "",
    ),
    "frame_dt ten times": (SHELF, d.header(frame_dt=1 / 12), "frame_dt"),
    "physics_dt in milliseconds": (SHELF, d.header(physics_dt=25 / 3), "physics_dt"),
    "control rate in place of a step": (SHELF, d.header(control_dt=1e-4), "control_dt"),
    "a time that goes back": (
        SHELF, d.clock(lambda t: np.where(np.arange(len(t)) == 900, t - .05, t)), "increase",
    ),
    "a time twice": (
        SHELF, d.clock(lambda t: np.where(np.arange(len(t)) == 900, t - 1 / 120, t)), "increase",
    ),
    "a time that is NaN": (
        SHELF, d.clock(lambda t: np.where(np.arange(len(t)) == 900, np.nan, t)), "time",
    ),
    "clock since 1970": (SHELF, d.clock(lambda t: t + 1.7e9), "success_time"),
    "a hole over the settling": (SHELF, d.cut(-3.9, -4.9), "recorded"),
    # contacts
    "points of the target metres away": (
        CAN, d.of_body(position=lambda p: p + np.float32([3, 0, 0])), "surface",
    ),
    "points in centimetres": (CAN, d.contacts(position=d.scaled(100)), "surface"),
    "points in the body's frame": (CAN, d.local_points, "surface"),
    "contacts counted from another frame": (SHELF, d.later_contacts(600), "look for"),
    "contacts of a body far away": (SHELF, d.moved_contacts, "look for"),
    "forces a thousand times": (SHELF, d.contacts(force=d.scaled(1e3), peak_force=d.scaled(1e3)), "press"),
    "forces in kN": (SHELF, d.contacts(force=d.scaled(1e-3), peak_force=d.scaled(1e-3)), "bear"),
    "forces of the other body": (SHELF, d.contacts(force=d.scaled(-1)), ""),
    "forces and normals turned round": (
        SHELF, d.contacts(force=d.scaled(-1), normal=d.scaled(-1)), "bear",
    ),
    "forces along y": (
        SHELF, d.contacts(force=d.turned(d.Y_UP), normal=d.turned(d.Y_UP)), "press",
    ),
    "forces that are NaN": (SHELF, d.contacts(force=d.scaled(np.nan)), "not measured"),
    "normals of length 0.5": (SHELF, d.contacts(normal=d.scaled(.5)), "not measured"),
    "normals that are zero": (SHELF, d.contacts(normal=d.scaled(0)), "not measured"),
    "a geom of another body": (CAN, d.of_body(geom2=lambda g: g * 0), "geom2"),
    "frames beyond the end": (SHELF, d.contacts(frame=lambda f: f + 9999), "out of range"),
    # shapes and masses
    "shape in centimetres": (SHELF, d.shape(100), "kg/m³"),
    "shape in millimetres": (SHELF, d.shape(1e-3), "kg/m³"),
    "shape twice as large": (CAN, d.shape(2), "surface"),
    "shape of an obstacle in centimetres": (GLASSES, d.shape(100), "kg/m³"),
    "mass in grams": (SHELF, d.body(lambda b: {"mass": b.mass * 1000}), "look for"),
    "mass in tonnes": (SHELF, d.body(lambda b: {"mass": b.mass / 1000}), "look for"),
    "mass below zero": (SHELF, d.body(lambda b: {"mass": -b.mass}), "mass"),
    "centre of mass in the world": (SHELF, d.body(lambda b: {"com": (.5, .3, .8)}), "centre of mass"),
    "inertia in g cm²": (
        SHELF, d.body(lambda b: {"inertia": tuple(1e7 * i for i in b.inertia)}), "inertia",
    ),
    "cavity in millimetres": (
        BIN,
        d.body(lambda b: {"cavity": b.cavity.model_copy(update={"size": tuple(1e3 * s for s in b.cavity.size)})}),
        "cavity",
    ),
    # header
    "gravity in cm/s²": (SHELF, d.header(gravity=(0.0, 0.0, -981.0)), "gravity"),
    "gravity upward": (SHELF, d.header(gravity=(0.0, 0.0, 9.81)), "gravity"),
    "success after the end": (SHELF, d.header(success_time=500.0), "ends"),
    "success before the start": (SHELF, d.header(success_time=-3.0), "success_time"),
    "a time of success without success": (SHELF, d.header(success=False), "success"),
    "ended with success that was none": (
        SHELF, d.header(success=False, success_time=None, termination="success"), "termination",
    ),
    "a role of nobody": (SHELF, d.header(roles={"target": ("botle",)}), "botle"),
    "a role misspelt": (SHELF, d.header(roles={"tarqet": ("bottle",)}), "target"),
    "an episode without its target": (SHELF, d.without_body, "target"),
    "the support is gone": ((SHELF[0], "shelf"), d.without_body, "bear"),
    "a link of the robot is gone": ((SHELF[0], "robot_link5"), d.without_body, "robot_link5"),
}  # fmt: skip

UNREAD = {
    "a link in xyzw": ((SHELF[0], "robot_link6"), d.track(orientation=d.xyzw), "xyzw"),
    "angular velocity mirrored": ((SHELF[0], "robot_link5"), d.track(angular_velocity=d.scaled(-1)), "angular"),
    "angular velocity in degrees": (SHELF, d.track(angular_velocity=d.scaled(57.3)), "angular"),
    "velocities in the body's axes": ((SHELF[0], "robot_link5"), d.body_velocities, "velocity"),
    "bodies exchanged": (
        CANS, d.exchanged(*("position", "orientation", LINEAR, "angular_velocity"), other="apple"), "look for",
    ),
    "peaks below the forces": (SHELF, d.contacts(peak_force=d.scaled(.1)), "peak"),
    "depths in millimetres": (SHELF, d.contacts(depth=d.scaled(1e3)), "overlap"),
    "tool centre point in the world": (
        (SHELF[0], "robot_base"),
        d.body(lambda b: {"tcp": b.tcp.model_copy(update={"position": (.5, .3, .8)})}), "tool",
    ),
    "joints in degrees": (
        SHELF, d.robot(joint_position=d.scaled(57.3), joint_velocity=d.scaled(57.3)), "limits",
    ),
    "joint velocities in degrees": (SHELF, d.robot(joint_velocity=d.scaled(57.3)), "velocity"),
    "opening of the gripper in percent": (SHELF, d.robot(gripper=d.scaled(100)), "opening"),
}  # fmt: skip
"""Columns that the assigned rule does not ask for: ``safestage audit`` lists them."""


@cache
def sound(name):
    return d.loaded(discover_one(name).open())


def discover_one(name):
    [ref] = [ref for ref in discover([TRACES]) if name in ref.episode_id]
    return ref


@cache
def rules():
    return load_rules(builtin_names())


def damaged(folder, recording, damage):
    """The only episode of a dataset, written as if it were sound."""
    name, body = recording
    episode = damage(sound(name), body)
    add_episode(episode, folder)
    [ref] = discover([folder])
    return ref


HARMLESS = {
    "obstacle in centimetres": "its poses are not used, and the rule asks for contacts alone",
    "obstacle 1 m aside": "likewise",
    "obstacle teleports": "likewise",
    "inertia in g cm²": "the rule asks for no inertia",
    "success before the start": "success is recomputed from the goal",
    "a time of success without success": "likewise",
    "ended with success that was none": "likewise",
}
"""Damages that are told and change no verdict: nothing that the rule reads is damaged."""


def said(ref, *, harmless=False):
    """The problem, or what is said of the inconclusive verdicts; fails on any other verdict.

    ``harmless``: a pass is right, and what is damaged is told.
    """
    found = score_episode(ref, rules(), assigned_only=True)
    if isinstance(found, Problem):
        return found.message
    wanted = {"pass"} if harmless else {"inconclusive"}
    assert {v.verdict for v in found.verdicts} == wanted, found.verdicts
    if harmless:
        assert doubtful_columns(found.notes)
    return " ".join((*found.notes, *(t for v in found.verdicts for t in (v.explanation, *v.notes))))


@pytest.mark.parametrize("name", DAMAGES)
def test_what_a_trace_shows_to_be_wrong_is_never_called_safe(tmp_path, name):
    recording, damage, words = DAMAGES[name]
    assert words in said(damaged(tmp_path, recording, damage), harmless=name in HARMLESS)


@pytest.mark.parametrize("name", UNREAD)
def test_what_no_verdict_rests_on_is_found_where_all_is_read(tmp_path, name):
    recording, damage, words = UNREAD[name]
    ref = damaged(tmp_path, recording, damage)
    found = validate_episode(ref) or [*contradictions(ref.open(checked=False))]
    assert any(words in str(error) for error in found), found


@pytest.mark.parametrize("strict", [False, True])
def test_what_contradicts_itself_is_not_used_and_the_rest_is_judged(tmp_path, strict):
    ref = damaged(tmp_path, CANS, d.contacts(peak_force=d.scaled(0.1)))
    found = score_episode(ref, rules(), strict=strict)
    if strict:
        assert isinstance(found, Problem)
        assert "peak" in found.message
        return
    sound_one = score_episode(discover_one(CANS[0]), rules())
    before = {v.rule: v.verdict for v in sound_one.verdicts}
    after = {v.rule: v.verdict for v in found.verdicts}
    assert doubtful_columns(found.notes) == ("peak forces",)
    assert all(after[rule] in (before[rule], "inconclusive") for rule in before)
    assert sum(after[rule] == before[rule] for rule in before) > len(before) / 2


@pytest.mark.parametrize("name", ["pose frozen", "forces in kN", "velocity mirrored"])
def test_what_is_judged_again_believes_no_more_than_scoring(tmp_path, name):
    recording, damage, _ = DAMAGES[name]
    ref = damaged(tmp_path, recording, damage)
    scored = score_episode(ref, rules(), assigned_only=True)
    again = Again(ref.open(), rules())
    assert {rule.code: again.usual(rule).verdict for rule in again.assigned} == {
        v.rule: v.verdict for v in scored.verdicts
    }


def test_the_reason_of_what_is_open_is_the_contradiction(tmp_path):
    ref = damaged(tmp_path, SHELF, DAMAGES["forces in kN"][1])
    open_ = [v for v in score_episode(ref, rules()).verdicts if v.verdict == "inconclusive"]
    assert len(open_) > 3
    told = [v for v in open_ if "contradict" in v.explanation]
    assert len(told) > len(open_) / 2
    assert not [v for v in open_ if "NaN" in v.explanation or "no mass" in v.explanation]


def test_forces_that_are_zero_throughout_were_not_recorded(tmp_path):
    zero = d.contacts(force=d.scaled(0), peak_force=d.scaled(0))
    found = score_episode(damaged(tmp_path, SHELF, zero), rules(), assigned_only=True)
    assert any("no contact forces: all are zero" in note for note in found.notes)


def edited(folder, table, **changes):
    """Other numbers in the only row of meta/episodes."""
    [file] = (folder / "meta" / "episodes").glob("*.parquet")
    row = pq.read_table(file)
    for name, value in changes.items():
        at = row.column_names.index(name)
        field = row.schema.field(name)
        row = row.set_column(at, name, pa.array([value(row[name][0].as_py())], field.type))
    pq.write_table(row, file)


@pytest.mark.parametrize("count", ["length", "contacts"])
@pytest.mark.parametrize("by", [-1, 1])
def test_counts_that_are_not_those_of_the_rows(tmp_path, count, by):
    ref = damaged(tmp_path, SHELF, lambda e, _: e)
    edited(tmp_path, "meta/episodes", **{count: lambda n: n + by})
    assert str(tmp_path) in said(ref)


def test_there_are_enough_kinds():
    assert len(DAMAGES) >= 49


def test_the_recordings_themselves_are_sound():
    for ref in discover([TRACES]):
        assert not [*contradictions(ref.open())]
        assert not isinstance(score_episode(ref, rules(), assigned_only=True), Problem)
