"""The arm's model: which files are one, and what is tuned."""

from __future__ import annotations

from pathlib import Path

import pytest

from safestage_eval.errors import InputError
from simulate.arm import droid

pytestmark = pytest.mark.simulate


def test_another_robot_is_refused(tmp_path: Path) -> None:
    other = tmp_path / "pole.xml"
    other.write_text(
        "<mujoco><worldbody><body name='b'><joint name='joint1'/>"
        "<geom size='.1'/></body></worldbody></mujoco>",
        encoding="utf-8",
    )
    with pytest.raises(InputError, match="it has no joint joint2"):
        droid.arm_spec(other)


def test_the_grip_is_gentle_and_the_pads_stick() -> None:
    spec = droid.arm_spec()
    finger = spec.actuator("fingers_actuator")
    assert list(finger.forcerange) == [-10, 10]
    pads = [g for g in spec.geoms if g.name.endswith(("_pad1", "_pad2"))]
    assert len(pads) == 4
    assert all(g.friction[0] == 1 and g.condim == 6 for g in pads)


def test_what_is_no_mjcf_is_named(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text("no xml at all", encoding="utf-8")
    with pytest.raises(InputError, match="not an MJCF file"):
        droid.arm_spec(file)
    file.write_text(
        "<mujoco><worldbody><body name='link0'/></worldbody></mujoco>", encoding="utf-8"
    )
    with pytest.raises(InputError, match="no actuator fingers_actuator, no site tcp, no body base"):
        droid.arm_spec(file)
