"""Summaries say what happened in recorded episodes, and show mistakes in files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.audit import audit
from safestage_eval.audit.campaign_summary import summarize
from safestage_eval.audit.subject import Subject
from safestage_eval.episode import ContactTable, Joint, RobotFrames, Track, with_header
from safestage_eval.formats import discover, save
from safestage_eval.rules import builtin_names, load_rules
from safestage_eval.verdicts import judge

TRACES = Path(__file__).parents[2] / "traces"
RULES = load_rules(builtin_names())
REFS = {ref.episode_id: ref for ref in discover([TRACES])}
GRAVE = ("error", "warning")


def recorded(part: str):
    """A recording, with all that it is read from in memory."""
    [name] = [name for name in REFS if part in name]
    return REFS[name].open()


def headed(episode, **fields):
    return with_header(episode, episode.header.model_copy(update=fields))


def acting(episode, action):
    f = episode.frames
    frames = RobotFrames(f.joint_position, f.joint_velocity, f.joint_torque, action, f.gripper)
    return replace(episode, _frames=frames)


def codes(tmp_path, *episodes, select=("AUD3",)):
    for i, episode in enumerate(episodes):
        save(episode, tmp_path / f"{i}.mcap")
    found = audit(tmp_path, select=select, jobs=1)
    assert not found.problems
    return {f.code: f for f in found.findings if f.severity in GRAVE}


@pytest.mark.parametrize("name", REFS)
def test_a_summary_says_what_the_verdicts_say(name):
    episode = REFS[name].open()
    kept, result = summarize(Subject(episode, RULES)), judge(episode, RULES)
    assert kept.success is result.success is True
    assert kept.goal.first == pytest.approx(kept.success_time, abs=0.02)
    assert not kept.goal.at_start
    assert kept.engaged is True and 0 < kept.touched < kept.target_moved < kept.success_time
    assert kept.stirred <= kept.target_moved
    assert kept.commands == "varied" and kept.robot_travel > 0.1
    assert dict(kept.start).keys() == {
        b.name for b in episode.header.bodies if b.movable and b.kind not in ("robot", "gripper")
    }
    assert len(kept.waypoints) < 10_000


def test_recorded_episodes_make_a_sound_evaluation():
    assert not [f for f in audit(TRACES, select=["AUD3"]).findings if f.severity in GRAVE]


@pytest.mark.parametrize("value", [np.nan, 0.3])
def test_commands_that_are_missing_or_never_change(tmp_path, value):
    episode = recorded("bottle_on_shelf.reference-safe")
    idle = acting(episode, np.full_like(episode.frames.action, value))
    found = codes(tmp_path, idle)
    assert set(found) == {"AUD321"}
    assert found["AUD321"].severity == "error"  # it counts as success


def test_a_copy_under_another_name(tmp_path):
    episode = recorded("bottle_on_shelf.reference-safe")
    copy = headed(episode, episode_id="again", policy="mine")
    assert set(codes(tmp_path, episode, copy)) == {"AUD331"}


def test_a_copy_that_was_written_anew(tmp_path):
    episode = recorded("bottle_on_shelf.reference-safe")
    shaken = replace(episode, _frames=RobotFrames.empty(len(episode)))
    copy = headed(shaken, episode_id="again", rollout=1)
    assert set(codes(tmp_path, episode, copy)) == {"AUD332"}


def test_success_before_anything_moved(tmp_path):
    episode = recorded("bottle_on_shelf.reference-safe")
    assert {"AUD311", "AUD314"} == set(codes(tmp_path, headed(episode, success_time=1.0)))


def test_success_without_a_touch(tmp_path):
    episode = recorded("bottle_on_shelf.reference-safe")
    index = {body.name: i for i, body in enumerate(episode.header.bodies)}
    robot = [i for name, i in index.items() if episode.bodies[name].kind in ("robot", "gripper")]
    c = episode.contacts
    mine = np.isin(c.body1, robot) | np.isin(c.body2, robot)
    columns = {name: getattr(c, name)[~mine] for name in ContactTable.__dataclass_fields__}
    found = codes(tmp_path, replace(episode, _contacts=ContactTable(**columns)))
    assert "AUD312" in found
    assert "it moved all the same" in found["AUD312"].what


def test_recorded_as_a_failure(tmp_path):
    episode = recorded("bottle_on_shelf.reference-safe")
    failed = headed(episode, success=False, success_time=None, termination="horizon")
    assert set(codes(tmp_path, failed)) == {"AUD314"}


def test_a_goal_that_holds_from_the_start(tmp_path):
    episode = recorded("orange_on_plate.reference-safe")
    late = int(np.searchsorted(episode.t, episode.header.success_time + 1))
    tracks = {
        name: track if len(track.position) == 1 else track.over(len(episode))
        for name, track in episode.tracks.items()
    }
    t = episode.t[late:] - episode.t[late]
    cut = {
        name: Track(*(column[late:] if len(column) > 1 else column
                            for column in track.columns.values()))
        for name, track in tracks.items()
    }  # fmt: skip
    c = episode.contacts
    kept = c.frame >= late
    columns = {name: getattr(c, name)[kept] for name in ContactTable.__dataclass_fields__}
    columns["frame"] = columns["frame"] - late
    begun = replace(
        episode, t=t, tracks=cut, channels={}, states={}, _contacts=ContactTable(**columns),
        _frames=RobotFrames.empty(len(t)),
    )  # fmt: skip
    begun = headed(begun, success_time=1.0)
    assert {"AUD311", "AUD313"} <= set(codes(tmp_path, begun))


def test_seeds_without_effect_and_scenes_that_drift(tmp_path):
    episode = recorded("bottle_on_shelf.reference-safe")
    other = recorded("bottle_on_shelf.reference-unsafe")
    same = headed(other, episode_id="b", seed=1, policy=episode.header.policy)
    assert "AUD301" in codes(tmp_path, episode, same)
    track = other.tracks["bottle"]
    moved = Track(track.position + np.float32([0.03, 0, 0]), *[*track.columns.values()][1:])
    drifted = replace(other, tracks={**other.tracks, "bottle": moved})
    assert "AUD302" in codes(tmp_path / "more", episode, drifted)


@pytest.mark.parametrize("joints", ["move", "stand still"])
def test_a_robot_whose_joints_move_is_not_called_still(joints):
    """Where its links have no poses, only the base is seen, which never moves."""
    scene = Scene(40, 20.0).fixed("table", (0, 0, 0)).fixed("base", (1, 0, 0), kind="robot")
    scene.bodies[-1] = scene.bodies[-1].model_copy(update={"movable": True})
    still = scene.tracks["base"]
    scene.tracks["base"] = Track(
        *(np.repeat(column, 40, axis=0) for column in (
            still.position, still.orientation, still.linear_velocity, still.angular_velocity))
    )  # fmt: skip
    angle = np.linspace(0, 1 if joints == "move" else 0, 40)[:, None].astype(np.float32)
    none = np.zeros((40, 0), np.float32)
    joint = Joint(name="elbow", kind="revolute", body="base")
    episode = scene.episode(joints=(joint,))
    frames = RobotFrames(angle, 0 * angle, none, none, none)
    travel = summarize(Subject(replace(episode, _frames=frames), RULES)).robot_travel
    assert travel == (None if joints == "move" else 0.0)
