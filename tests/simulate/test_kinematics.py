"""Kinematics of the arm alone: that of the arm in a scene, and its own inverse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from simulate.arm.droid import HOME
from simulate.arm.kinematics import ArmAlone
from simulate.record.rollout import Setting, start
from simulate.tasks.task import task_named
from simulate.world.privileged import PrivilegedState

pytestmark = pytest.mark.simulate

ARM = ArmAlone()
OFF = st.lists(st.floats(-0.3, 0.3), min_size=7, max_size=7)


def test_it_is_the_arm_of_the_scenes() -> None:
    world = start(Setting(task_named("fsh_orange_on_plate")))
    state = PrivilegedState(world)
    position, rotation = ARM.tcp(np.array(world.data.qpos[world.arm_qpos]))
    seen, turned = state.tcp
    assert position == pytest.approx(seen, abs=2e-3), "poses after a step are those of before it"
    assert rotation == pytest.approx(turned, abs=5e-3)
    aim = seen + np.array([0.05, -0.1, 0.03])
    alone, _ = ARM.joints(aim, turned, state.arm_position)
    there, _ = state.inverse_kinematics(aim, turned, state.arm_position)
    assert alone == pytest.approx(there, abs=1e-9)


@settings(max_examples=25, deadline=None)
@given(OFF)
def test_the_inverse_leads_back_to_the_pose(off: list[float]) -> None:
    position, rotation = ARM.tcp(HOME + np.array(off))
    joints, error = ARM.joints(position, rotation, HOME)
    if error < 1e-3:  # what the search from home reaches at all
        found, turned = ARM.tcp(joints)
        assert found == pytest.approx(position, abs=1.1e-3)
        assert np.trace(turned.T @ rotation) > 2.9


def test_most_poses_near_home_are_reached() -> None:
    random = np.random.default_rng(0)
    poses = [ARM.tcp(HOME + random.uniform(-0.3, 0.3, 7)) for _ in range(50)]
    assert sum(ARM.joints(*pose, HOME)[1] < 1e-3 for pose in poses) >= 45
