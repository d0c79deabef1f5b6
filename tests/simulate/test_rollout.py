"""One rollout: determinism, success, the frozen hold, actions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.errors import InputError
from safestage_eval.rules.load import load_rules
from safestage_eval.verdicts.judging import judge
from simulate.policies.controls import Idle
from simulate.policies.policy_names import policy_named
from simulate.policy import Observation
from simulate.record.rollout import Setting, roll_out
from simulate.tasks.task import Placement, Task, task_named
from simulate.world.world import FRAMES_PER_ACTION

pytestmark = pytest.mark.simulate


def done_already() -> Task:
    """The orange lies on the plate from the start."""
    task = task_named("fsh_orange_on_plate")
    plate = task.objects["plate"]
    on_it = Placement(on="plate", position=(0.0, 0.0))
    return task.model_copy(update={"objects": {"plate": plate, "orange": on_it}})


class Sweep:
    """Turns joint 1 by 0.02 rad per action, in chunks of three."""

    name = "sweep"

    def reset(self, _task: str, prompt: str) -> None:
        self.prompts, self.calls, self.angle = [prompt], 0, 0.0

    def act(self, observation: Observation) -> NDArray[np.float64]:
        if self.calls == 0:
            self.start = observation.joint_position.copy()
        self.calls += 1
        self.prompts.append(observation.instruction)
        chunk = np.tile(np.append(self.start, 1.0), (3, 1))
        chunk[:, 0] += self.angle + 0.02 * np.arange(1, 4)
        self.angle += 0.06
        return chunk


@pytest.fixture(scope="module")
def success() -> Episode:
    sweep = Sweep()
    return roll_out(Setting(done_already()), sweep).episode()


def test_success_is_the_third_frame_of_the_goal_and_is_latched(success: Episode) -> None:
    assert success.header.success is True
    assert success.header.success_time == pytest.approx(2 / 120)
    assert success.header.termination == "success"


def test_the_hold_is_recorded_whole(success: Episode) -> None:
    held = success.t[-1] - (success.header.success_time or 0)
    assert success.header.post_success_hold == 5
    assert 5.0 <= held <= 5.0 + 2 / 15


def test_the_arm_is_frozen_where_it_was_measured(success: Episode) -> None:
    action = success.frames.action
    confirming = action[:8]
    frozen = action[8:]
    assert np.ptp(frozen, axis=0).max() == 0
    assert np.ptp(confirming, axis=0).max() == 0
    assert frozen[0, 7] == confirming[0, 7] == 1  # the gripper's command is kept
    joints = success.frames.joint_position[:, :7]
    assert np.abs(frozen[0, :7] - joints[8]).max() < 2e-3
    assert np.abs(joints[-1] - joints[8]).max() < 0.01


def test_offline_success_agrees_with_the_live_one(success: Episode) -> None:
    rules = load_rules(["goals", "fsh"])
    blank = Episode(
        success.header.model_copy(update={"success": None, "success_time": None}),
        success.t,
        success.tracks,
        success.contacts,
        success.frames,
        success.meshes,
    )
    again = judge(blank, rules)
    assert again.success_time == pytest.approx(success.header.success_time)


def test_the_same_seed_gives_the_same_bytes() -> None:
    def run(seed: int) -> str:
        setting = Setting(task_named("fsh_orange_on_plate"), seed, horizon=3.0)
        return roll_out(setting, policy_named("reference:unsafe")).episode().content_hash

    first = run(1)
    assert run(1) == first
    assert run(2) != first


def test_idle_holds_still_until_the_horizon() -> None:
    writer = roll_out(Setting(task_named("ish_coffee_can_under_bottle"), horizon=1.0), Idle())
    header, episode = writer.header, writer.episode()
    assert (header.success, header.termination, header.success_time) == (False, "horizon", None)
    assert len(episode) == 120
    assert header.post_success_hold is None
    joints = episode.frames.joint_position
    assert np.ptp(joints, axis=0).max() < 5e-3
    for name in ("coffee_can", "white_bottle", "plate"):
        assert np.ptp(episode.tracks[name].position, axis=0).max() < 1e-4, "settled before"


def test_chunks_are_played_whole_and_actions_are_recorded_in_force() -> None:
    sweep = Sweep()
    task = task_named("ets_dumbbell_near_glasses")
    setting = Setting(task, prompt="specific", horizon=0.6)
    episode = roll_out(setting, sweep).episode()
    assert sweep.calls == 3  # nine actions in 0.6 s
    assert set(sweep.prompts) == {task.prompts.specific}
    assert episode.header.instruction == task.prompts.specific
    steps = episode.frames.action[:, 0].reshape(9, 8)
    assert np.ptp(steps, axis=1).max() == 0
    assert np.diff(steps[:, 0]) == pytest.approx(0.02, abs=1e-6)
    assert episode.frames.gripper[-1] < episode.frames.gripper[0]


@pytest.mark.parametrize(
    "bad", [np.zeros(8), np.zeros((1, 7)), np.zeros((0, 8)), np.full((1, 8), np.nan)]
)
def test_actions_that_are_none_are_refused(bad: NDArray[np.float64]) -> None:
    class Bad(Idle):
        def act(self, observation: Observation) -> NDArray[np.float64]:
            return bad

    writer = roll_out(Setting(task_named("ish_coffee_can_under_bottle"), horizon=1.0), Bad())
    assert (writer.header.termination, writer.header.success) == ("error", None)
    assert (
        "action 0 of its answer is not finite" if bad.size == 8 and bad.ndim == 2 else "(N, 8)"
    ) in (writer.header.notes[-1])
    assert len(writer) == FRAMES_PER_ACTION, "there is something to look at"


@pytest.mark.parametrize("when", [0, 3])
def test_what_a_policy_raises_is_an_error_of_the_rollout(when: int) -> None:
    """Whatever it is; the note says which, and where in the user's file it came from."""

    class Raising(Idle):
        calls = 0

        def act(self, observation: Observation) -> NDArray[np.float64]:
            if self.calls == when:
                raise ZeroDivisionError("first line\nno weights")
            self.calls += 1
            return super().act(observation)

    writer = roll_out(Setting(task_named("ish_coffee_can_under_bottle"), horizon=1.0), Raising())
    assert (writer.header.termination, writer.header.success) == ("error", None)
    note = writer.header.notes[-1]
    assert "test_rollout.py, line" in note
    assert note.endswith("ZeroDivisionError: no weights.")
    assert len(writer) == max(when, 1) * FRAMES_PER_ACTION


def test_what_a_policy_raises_in_its_reset_is_one_too() -> None:
    class Unready(Idle):
        def reset(self, task: str, prompt: str) -> None:
            raise OSError("no such checkpoint")

    writer = roll_out(Setting(task_named("ish_coffee_can_under_bottle"), horizon=1.0), Unready())
    assert writer.header.termination == "error"
    assert "OSError: no such checkpoint" in writer.header.notes[-1]


def test_the_header_carries_the_task(success: Episode) -> None:
    header, task = success.header, task_named("fsh_orange_on_plate")
    assert (header.task, header.stage, header.family) == (task.id, task.stage, task.family)
    assert header.roles == task.roles
    assert header.rules == task.rules
    assert header.goal == task.goal
    assert header.physics_dt == pytest.approx(1 / 480)
    assert header.force_source == "recorded"
    assert header.source.simulator_version


def test_an_unknown_prompt_is_named() -> None:
    with pytest.raises(InputError, match="no such prompt"):
        roll_out(Setting(task_named("fsh_bottle_on_shelf"), prompt="polite"), Idle())


def test_another_setting_is_another_episode() -> None:
    task = task_named("fsh_orange_on_plate")
    usual = Setting(task).episode_id("idle")
    assert usual == "fsh_orange_on_plate.idle.default.s0.r0"
    assert Setting(task, horizon=task.horizon).episode_id("idle") == usual
    assert Setting(task, horizon=12.5).episode_id("idle") == f"{usual}.h12.5"
    assert (
        Setting(task, robot_mjcf=Path("other_arm.xml")).episode_id("idle") == f"{usual}.other_arm"
    )
