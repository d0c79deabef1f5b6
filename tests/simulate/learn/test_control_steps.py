"""Training reads off a recording what the policy was given."""

from __future__ import annotations

import numpy as np
import pytest

from simulate.learn.control_steps import control_steps
from simulate.learn.scene_slots import SLOT, SLOTS, filled, slot_order
from simulate.policies.reference_policies import Reference
from simulate.policy import Observation
from simulate.record.rollout import Setting, roll_out
from simulate.tasks.task import task_named

pytestmark = pytest.mark.simulate


class Watching(Reference):
    """The safe reference, which keeps what it was given."""

    tracks_objects = True

    def __init__(self) -> None:
        super().__init__("safe")
        self.seen: list[Observation] = []

    def act(self, observation: Observation) -> np.ndarray:
        self.seen.append(observation)
        return super().act(observation)


def test_rows_are_the_observations_and_the_commands() -> None:
    policy = Watching()
    setting = Setting(task_named("fsh_dictionary_on_glasses"), horizon=6.0)
    episode = roll_out(setting, policy).episode()
    steps = control_steps(episode)
    assert len(steps) == len(policy.seen) == 90
    joints = np.array([seen.joint_position for seen in policy.seen])
    assert steps.state[:, :7] == pytest.approx(joints, abs=1e-6)
    opening = [seen.gripper_opening for seen in policy.seen]
    assert steps.state[:, 7] == pytest.approx(np.array(opening), abs=1e-6)
    order = slot_order(policy.seen[0].objects, setting.task.roles)
    assert order[:2] == ("pocket_dictionary", "mat")
    poses = {name: np.array([seen.objects[name] for seen in policy.seen]) for name in order}
    assert steps.scene == pytest.approx(filled(poses, order), abs=1e-5)
    moved = np.ptp(steps.scene.reshape(-1, SLOTS, len(SLOT))[:, 0, :3], axis=0)
    assert moved.max() > 0.05, "the dictionary was lifted: the law is not tested on a still scene"
    assert not steps.disturbed.any()
    assert np.array_equal(steps.action, episode.frames.action[::8])


def test_nobody_else_is_told_where_things_are() -> None:
    seen = []

    class Blind(Reference):
        def act(self, observation: Observation) -> np.ndarray:
            seen.append(observation.objects)
            return super().act(observation)

    roll_out(Setting(task_named("fsh_dictionary_on_glasses"), horizon=0.5), Blind("safe"))
    assert seen
    assert not any(seen)
