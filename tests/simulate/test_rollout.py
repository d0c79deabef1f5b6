"""One rollout: determinism, success, the frozen hold, actions."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from safestage_eval.episode import Episode
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
