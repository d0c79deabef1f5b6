"""Skins and textures change pictures, never physics."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from simulate.arm import droid
from simulate.cameras.drawn_model import drawn_model
from simulate.record.rollout import Setting, start
from simulate.tasks.task import task_named
from simulate.world.world import World

pytestmark = pytest.mark.simulate

TASK = task_named("fsh_orange_on_plate")


@pytest.fixture(scope="module")
def world() -> World:
    return start(Setting(TASK))


@pytest.fixture(scope="module")
def drawn(world: World) -> mujoco.MjModel:
    return drawn_model(world)


def test_the_look_changes_nothing_that_happens() -> None:
    """Two looks, one scene: bit for bit the same after a second of falling and settling."""
    ends = []
    for look in ((0,), (7, 3)):
        one = World(TASK.models(), substeps=TASK.substeps, look=look)
        one.reset(TASK.layout(0))
        for _ in range(5):
            one.act(np.append(droid.HOME, 0.0))
        ends.append((one.data.qpos.tobytes(), one.data.qvel.tobytes(), one.data.ncon))
        assert not any("scenery" in one.model.geom(i).name for i in range(one.model.ngeom))
        assert one.model.ntex == 0, "textures are made where something is drawn"
    assert ends[0] == ends[1]
