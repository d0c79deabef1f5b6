"""The simulated world: table, arm and objects in MuJoCo, stepped by eight-dimensional actions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from simulate.arm import droid
from simulate.catalogue.objects import ObjectModel
from simulate.catalogue.surfaces import friction

FRAME_RATE = 120
"""Hz at which frames are recorded."""
CONTROL_RATE = 15
"""Hz of actions."""
FRAMES_PER_ACTION = FRAME_RATE // CONTROL_RATE
TABLE_HALF = (0.45, 0.6, 0.02)
"""m; the table's top is z = 0, its middle 0.5 m in front of the robot's base."""
TABLE_CENTRE = (0.5, 0.0, -0.02)
FLOOR_Z = -0.75

F64 = NDArray[np.float64]


class World:
    """A compiled scene and its state."""

    def __init__(
        self,
        objects: dict[str, ObjectModel],
        *,
        substeps: int = 1,
        robot_mjcf: Path | None = None,
        look: tuple[int, ...] = (0,),
    ) -> None:
        """Compile a scene; objects are put at their places by ``reset``.

        Args:
            objects: name → what it is.
            substeps: physics steps per recorded frame: 1, or 4 where things bounce or roll.
            robot_mjcf: another MJCF of the arm.
            look: numbers that cameras' places, and what they see besides, are drawn from; nothing
                that happens depends on them.
        """
        self.objects = objects
        self.substeps = substeps
        self.robot_mjcf = robot_mjcf
        self.look = look
        self.model = scene_spec(objects, substeps, robot_mjcf, look).compile()
        self.data = mujoco.MjData(self.model)
        model = self.model
        self.arm_qpos = np.array([model.joint(n).qposadr[0] for n in droid.JOINTS])
        self.arm_dof = np.array([model.joint(n).dofadr[0] for n in droid.JOINTS])
        self.arm_range = np.array([model.joint(n).range for n in droid.JOINTS])
        self._arm_ctrl = np.array([model.actuator(n).id for n in droid.JOINTS])
        self._grip_ctrl = model.actuator(droid.GRIPPER_ACTUATOR).id
        self.tcp = model.site(droid.TCP_SITE).id
        self._last_link = model.body(droid.LAST_LINK).id
        self._now = mujoco.MjData(model)
        driver = model.joint(droid.GRIPPER_JOINT)
        self._grip_qpos = int(driver.qposadr[0])
        self._grip_range = (float(driver.range[0]), float(driver.range[1]))
        self.body_id = {name: model.body(name).id for name in objects}

    def reset(self, poses: dict[str, tuple[F64, F64]]) -> None:
        """Put the arm home and the objects at (position (3,) m, orientation (4,) wxyz)."""
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[self.arm_qpos] = droid.HOME
        self.data.ctrl[self._arm_ctrl] = droid.HOME
        for name, (position, orientation) in poses.items():
            if self.objects[name].fixed:
                body = self.body_id[name]
                self.model.body_pos[body], self.model.body_quat[body] = position, orientation
            else:
                start = self.model.joint(f"{name}/free").qposadr[0]
                self.data.qpos[start : start + 7] = np.concatenate([position, orientation])
        mujoco.mj_forward(self.model, self.data)

    def act(self, action: F64, each_substep: Callable[[int], None] | None = None) -> None:
        """Apply one action for 1/15 s; ``each_substep`` is called with the substep within the frame."""
        self.data.ctrl[self._arm_ctrl] = action[:7]
        self.data.ctrl[self._grip_ctrl] = 255.0 if action[7] > 0.5 else 0.0
        for _ in range(FRAMES_PER_ACTION):
            for substep in range(self.substeps):
                mujoco.mj_step(self.model, self.data)
                if each_substep is not None:
                    each_substep(substep)

    @property
    def arm_position(self) -> F64:
        """(7,) rad, measured."""
        return np.array(self.data.qpos[self.arm_qpos])

    @property
    def flange(self) -> tuple[F64, F64]:
        """Position (3,) m and orientation (4,) wxyz of the arm's flange, in the frame of its base."""
        now, body = self._now, self._last_link
        now.qpos[:] = self.data.qpos  # poses after a step still are those of before it
        mujoco.mj_kinematics(self.model, now)
        out = now.xmat[body].reshape(3, 3)[:, 2]
        return now.xpos[body] + droid.FLANGE * out, now.xquat[body].copy()

    def object_poses(self) -> dict[str, F64]:
        """Object → (7,) its origin (m) and orientation (wxyz), world, as they are now."""
        now = self._now
        now.qpos[:] = self.data.qpos
        mujoco.mj_kinematics(self.model, now)
        return {
            name: np.concatenate([now.xpos[body], now.xquat[body]])
            for name, body in self.body_id.items()
        }

    @property
    def gripper_opening(self) -> float:
        """0 closed … 1 open, measured."""
        low, high = self._grip_range
        share = (float(self.data.qpos[self._grip_qpos]) - low) / (high - low)
        return min(max(1.0 - share, 0.0), 1.0)


def scene_spec(
    objects: dict[str, ObjectModel],
    substeps: int = 1,
    robot_mjcf: Path | None = None,
    look: tuple[int, ...] = (0,),
    *,
    visuals: bool = False,
) -> mujoco.MjSpec:
    """Table, floor, objects and arm, not compiled yet.

    Args:
        objects: as ``World`` takes them.
        substeps: as well.
        robot_mjcf: as well.
        look: as well.
        visuals: with the arm's meshes that are only seen; a model that is stepped has none.
    """
    spec = mujoco.MjSpec()
    spec.modelname = "safestage"
    option = spec.option
    option.timestep = 1.0 / (FRAME_RATE * substeps)
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = 50
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1280, 960
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    world = spec.worldbody
    world.add_light(pos=[0.2, -0.6, 1.8], dir=[0.15, 0.3, -1], diffuse=[0.6, 0.6, 0.6])
    table = world.add_body(name="table")
    table.add_geom(
        name="table/top", type=mujoco.mjtGeom.mjGEOM_BOX, size=TABLE_HALF, pos=TABLE_CENTRE,
        friction=friction("wood"), condim=6, rgba=[0.72, 0.6, 0.45, 1],
    )  # fmt: skip
    floor = world.add_body(name="floor", pos=[0, 0, FLOOR_Z])
    floor.add_geom(
        name="floor/plane", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[3, 3, 0.1],
        friction=friction("stone"), condim=6, rgba=[0.35, 0.37, 0.4, 1],
    )  # fmt: skip
    for name, model in objects.items():
        model.add_to(spec, name)
    robot = droid.arm_spec(robot_mjcf, visuals=visuals, look=look)
    world.add_frame().attach_body(robot.body("link0"), droid.PREFIX, "")
    return spec
