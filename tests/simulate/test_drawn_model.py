"""Skins and textures change pictures, never physics."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from simulate.arm import droid
from simulate.cameras.drawn_model import HIDDEN_GROUP, drawn_model
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


def test_a_state_of_the_world_fits_into_the_drawn_model(
    world: World, drawn: mujoco.MjModel
) -> None:
    """Same joints at the same places, and every body where the world has it."""
    joints = [drawn.joint(i).name for i in range(drawn.njnt)]
    assert joints == [world.model.joint(i).name for i in range(world.model.njnt)]
    assert np.array_equal(drawn.jnt_qposadr, world.model.jnt_qposadr)
    bodies = [drawn.body(i).name for i in range(drawn.nbody)]
    assert bodies == [world.model.body(i).name for i in range(world.model.nbody)]
    data, exact = mujoco.MjData(drawn), mujoco.MjData(world.model)
    data.qpos[:] = exact.qpos[:] = world.data.qpos
    mujoco.mj_kinematics(drawn, data)
    mujoco.mj_kinematics(world.model, exact)
    moving = [world.body_id[name] for name, model in TASK.models().items() if not model.fixed]
    assert np.array_equal(data.xpos[moving], exact.xpos[moving])


def test_what_is_only_seen_has_no_contact_and_no_mass(world: World, drawn: mujoco.MjModel) -> None:
    """The dressed model collides and weighs exactly as the world does, and hides what collides."""
    solid = (drawn.geom_contype != 0) | (drawn.geom_conaffinity != 0)
    plain = (world.model.geom_contype != 0) | (world.model.geom_conaffinity != 0)
    assert solid.sum() == plain.sum()
    assert np.array_equal(drawn.body_mass, world.model.body_mass)
    assert np.array_equal(drawn.body_inertia, world.model.body_inertia)
    for name in ("table", "floor", *TASK.models()):
        of = (drawn.geom_bodyid == drawn.body(name).id) & solid
        assert (drawn.geom_group[of] == HIDDEN_GROUP).all(), name


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
