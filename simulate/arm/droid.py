"""The DROID arm: a 7-DoF Franka Panda with a Robotiq 2F-85 gripper, as a MuJoCo spec."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from safestage_eval.errors import InputError

PREFIX = "robot/"
JOINTS = tuple(f"{PREFIX}joint{i}" for i in range(1, 8))
GRIPPER_JOINT = f"{PREFIX}left_driver_joint"
GRIPPER_ACTUATOR = f"{PREFIX}fingers_actuator"
TCP_SITE = f"{PREFIX}tcp"
LAST_LINK = f"{PREFIX}link7"
FLANGE = 0.107
"""m, from the last link's frame along its z to the flange (Franka's kinematics: panda_link8)."""
GRIPPER_ROOT = "base"
"""Body from which on the robot is gripper."""

HOME = np.array([0.0, -0.2, 0.0, -0.8, 0.0, 0.6, 0.0]) * np.pi
"""(7,) rad, where every episode starts."""

GRIP_FORCE = 10.0
"""N, range of the gripper's tendon actuator: about 200 N between the pads (50 gives 1,000 N)."""
GRIP_BEYOND = 0.05
"""rad of the driver joint that a closing gripper aims beyond closed: it presses with all its force on
what is wider than 5 mm, and with half of it at 0. (The model's own servo gives way from 10 mm on.)"""
PAD_FRICTION = (1.0, 0.02, 0.0001)
"""Sliding (-), torsional and rolling (m) of the pads: rubber, 22 mm wide. They have priority: it is theirs on
whatever they touch. The fingers' hulls, which reach around the pads and hold with them, have the model's 1."""


@dataclass(frozen=True)
class Mounted:
    """A camera beside the arm."""

    position: tuple[float, float, float]
    """m, in the frame of the arm's base."""
    orientation: tuple[float, float, float, float]
    """wxyz, camera to base; the camera looks along its −z, with y up."""
    fovy: float
    """deg, vertical angle of view."""


RESOLUTION = (1280, 720)
"""Pixels: width, height, of all DROID's cameras."""
ZED_2_FOVY = 68.6
"""deg, vertical, of a ZED 2's rectified picture of 1280 × 720: a published factory calibration has a focal
length of 528.3 pixels, and 2 atan(360 / 528.3) = 68.6°. (RoboLab has 71.5°, of the lens without
rectification: 3.024 mm behind 2.1 mm.)"""
OUTSIDE = {
    "exterior_left": Mounted((0.05, 0.57, 0.66), (-0.393, -0.195, 0.399, 0.805), ZED_2_FOVY),
    "exterior_right": Mounted((0.05, -0.57, 0.66), (0.805, 0.399, -0.195, -0.393), ZED_2_FOVY),
}
"""DROID's two ZED 2 (Khazatsky et al., "DROID", RSS 2024: one on either side of the arm, on mounts that
adjust) as RoboLab places them (``robolab/variations/camera.py``). The third, a ZED Mini on the wrist, is
of the arm's own model: 56.7°, where Stereolabs give 54° for 1280 × 720."""
SHIFT, TURN = 0.03, 2.0
"""m along each axis and deg about each, by which an outer camera's place varies at most: a mount set up
anew. DROID's published extrinsics (one pose per camera and episode) were not sampled."""


def outside_cameras(look: tuple[int, ...]) -> dict[str, Mounted]:
    """The outer cameras where they stand for a look, near ``OUTSIDE``; the same look, the same place."""
    rng = np.random.default_rng([*look, 2])
    out = {}
    for name, at in OUTSIDE.items():
        x, y, z = at.position + rng.uniform(-SHIFT, SHIFT, 3)
        turn, whole = np.empty(4), np.empty(4)
        mujoco.mju_euler2Quat(turn, np.radians(rng.uniform(-TURN, TURN, 3)), "xyz")
        orientation = np.array(at.orientation) / np.linalg.norm(at.orientation)
        mujoco.mju_mulQuat(whole, orientation, turn)
        w, i, j, k = whole
        turned = (float(w), float(i), float(j), float(k))
        out[name] = Mounted((float(x), float(y), float(z)), turned, at.fovy)
    return out


def default_mjcf() -> Path:
    """The arm's MJCF in the pinned ``tabletask`` wheel (MuJoCo Menagerie's, Apache-2.0 / BSD-2).

    Raises InputError when the wheel is not installed.
    """
    spec = importlib.util.find_spec("tabletask")
    if spec is None or not spec.submodule_search_locations:
        raise InputError(
            "the DROID arm",
            "its model is not installed.",
            fix="pip install 'safestage[simulate]', or name an MJCF of the arm with --robot-mjcf",
        )
    root = Path(spec.submodule_search_locations[0])
    return root / "mujoco" / "robots" / "assets" / "droid" / "model.xml"


def arm_spec(
    mjcf: Path | None = None, *, visuals: bool = False, look: tuple[int, ...] = (0,)
) -> mujoco.MjSpec:
    """The arm alone, tuned for stable grasps at 120 Hz.

    Args:
        mjcf: another MJCF of the same arm.
        visuals: keep the meshes that are only seen (needed for pictures, slow to compile).
        look: what the places of the outer cameras are drawn from.

    Raises InputError when the file is not there or is not this arm.
    """
    path = mjcf or default_mjcf()
    if not path.is_file():
        raise InputError(str(path), "no such MJCF file.", "an MJCF of the DROID arm")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise InputError(
            str(path), f"not an MJCF file: {error}", "an MJCF of the DROID arm"
        ) from None
    missing = _missing(spec)
    if missing:
        raise InputError(str(path), f"not the DROID arm: it has no {', no '.join(missing)}")
    if not visuals:
        _drop_visuals(spec)
    for name, at in outside_cameras(look).items():
        spec.body("link0").add_camera(
            name=name, pos=at.position, quat=at.orientation, fovy=at.fovy, resolution=RESOLUTION
        )
    for actuator in spec.actuators:
        if actuator.name == GRIPPER_ACTUATOR.removeprefix(PREFIX):
            actuator.forcerange = [-GRIP_FORCE, GRIP_FORCE]
            actuator.gainprm[0] -= GRIP_BEYOND * actuator.biasprm[1] / actuator.ctrlrange[1]
    for geom in spec.geoms:
        if geom.name.endswith(("_pad1", "_pad2")):
            geom.friction, geom.condim = PAD_FRICTION, 6
    return spec


def _missing(spec: mujoco.MjSpec) -> list[str]:
    """Changes that turn the model into the DROID arm."""
    wanted = {
        "joint": (spec.joint, (*JOINTS, GRIPPER_JOINT)),
        "actuator": (spec.actuator, (*JOINTS, GRIPPER_ACTUATOR)),
        "site": (spec.site, (TCP_SITE,)),
        "body": (spec.body, ("link0", GRIPPER_ROOT)),
    }
    return [
        f"{kind} {name.removeprefix(PREFIX)}"
        for kind, (find, names) in wanted.items()
        for name in names
        if find(name.removeprefix(PREFIX)) is None
    ]


def _drop_visuals(spec: mujoco.MjSpec) -> None:
    mesh = mujoco.mjtGeom.mjGEOM_MESH
    for geom in list(spec.geoms):
        if geom.contype == 0 and geom.conaffinity == 0 and geom.type == mesh:
            spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms if geom.type == mesh}
    for asset in list(spec.meshes):
        if (asset.name or Path(asset.file).stem) not in used:
            spec.delete(asset)
