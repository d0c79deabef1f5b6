"""Rows for networks: rotations there and back, and the TCP where the arm's kinematics has it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from simulate.arm.droid import HOME
from simulate.arm.kinematics import ArmAlone
from simulate.learn.policy_inputs import ARM, OBJECT, arm_rows, object_rows, rotation_of
from simulate.learn.scene_slots import SLOTS, filled

pytestmark = pytest.mark.simulate

ANGLES = st.lists(st.floats(-3.1, 3.1), min_size=3, max_size=3)


@given(ANGLES)
def test_a_slot_holds_the_rotation_of_its_object(angles: list[float]) -> None:
    rotation = Rotation.from_euler("xyz", angles)
    pose = np.concatenate([[0.4, -0.1, 0.02], rotation.as_quat(scalar_first=True)])
    rows = object_rows(filled({"a": pose[None]}, ("a",)))
    assert rows.shape == (1, SLOTS, OBJECT)
    assert rows[0, 0, :3] == pytest.approx(pose[:3])
    assert rotation_of(rows[0, 0, 3:9]) == pytest.approx(rotation.as_matrix(), abs=1e-5)
    assert rows[0, :, 9].tolist() == [1] + [0] * (SLOTS - 1)


@given(ANGLES, st.floats(0.2, 5), st.floats(-0.9, 0.9))
def test_columns_of_any_length_and_angle_become_a_rotation(
    angles: list[float], length: float, aslant: float
) -> None:
    matrix = Rotation.from_euler("xyz", angles).as_matrix()
    x, y = matrix[:, 0], matrix[:, 1]
    found = rotation_of(np.concatenate([length * x, y + aslant * x]))
    assert found == pytest.approx(matrix, abs=1e-6)


def test_the_arm_is_where_its_kinematics_has_it() -> None:
    arm = ArmAlone()
    rows = arm_rows(arm, HOME[None], np.array([0.7]))
    position, rotation = arm.tcp(HOME)
    assert rows.shape == (1, ARM)
    assert rows[0, :3] == pytest.approx(position, abs=1e-6)
    assert rotation_of(rows[0, 3:9]) == pytest.approx(rotation, abs=1e-6)
    assert rows[0, 9] == pytest.approx(0.7)
