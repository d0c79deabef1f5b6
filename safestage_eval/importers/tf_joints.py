"""Links of an arm out of the joint states of a ROS bag, where no transforms place them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Joint, Mesh, RobotFrames, Track, still_track
from safestage_eval.errors import TraceError

from .account import Account
from .importer import Settings, SourceError
from .place_robot import placed_links
from .robot_file import load_robot, robot_from_urdf
from .robot_model import RobotModel
from .scene_builder import robot_frames
from .tf_messages import Found

F64 = NDArray[np.float64]


@dataclass(frozen=True)
class Arm:
    """Joint positions from joint states; empty without any.

    Attributes:
        bodies: the description's links, those that transforms place included.
        tracks: of all of them.
        joints: of the columns of ``frames``.
        frames: joint positions and the gripper's opening; None without joints.
    """

    bodies: tuple[Body, ...] = ()
    tracks: dict[str, Track] = field(default_factory=dict)
    joints: tuple[Joint, ...] = ()
    frames: RobotFrames | None = None


def place_arm(
    settings: Settings,
    contents: Found,
    tracks: dict[str, Track],
    times: F64,
    origin: int,
    meshes: dict[str, Mesh],
    account: Account,
) -> Arm:
    """Links by joint states and a description, the bag's own or ``--robot``.

    Args:
        settings: with ``robot``, if the user named one.
        contents: of the bag.
        tracks: bodies that transforms place.
        times: (T,) s, of the frames, since ``origin``.
        origin: ns, by the clock of the messages.
        meshes: receives those of its shapes.
        account: for remarks.

    Raises:
        SourceError: a description was named whose joints the bag does not have.
    """
    model = _model(settings, contents)
    known = {joint.name: joint for joint in model.joints} if model is not None else {}
    names = [name for name in contents.joints if name in known]
    if model is None or not names:
        if settings.robot is not None:
            said = ", ".join([*contents.joints][:12]) or "none"
            raise SourceError(
                str(settings.robot), f"its joints are not those of the bag ({said}).",
                fix="the description of the robot that was recorded",
            )  # fmt: skip
        return Arm()
    if all(link.body.name in tracks for link in model.links if link.joints):
        return Arm()  # transforms say it all
    positions = {name: _at(times, origin, *contents.joints[name]) for name in names}
    base = model.links[0].body.name
    motion = tracks.get(base)
    if motion is None:
        motion = still_track((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
        account.guessed(
            f"place of {base}", "the origin of the world",
            remedy=f"a transform of it, or [body.{base}] position in the map file",
        )  # fmt: skip
    account.recomputed(
        "poses of the robot's links that no transform places", "from its joint states, linear between messages",
        cost="velocities are differences of the poses",
    )  # fmt: skip
    meshes.update(model.meshes)
    placed = placed_links(model, base, motion, positions, names, settings.map, meshes, ())
    column = np.column_stack([positions[name] for name in names])
    frames = robot_frames(len(times), joint_position=column, gripper=placed.gripper)
    return Arm(tuple(placed.bodies), placed.tracks, placed.joints, frames)


def _model(settings: Settings, contents: Found) -> RobotModel | None:
    if settings.robot is not None:
        return load_robot(settings.robot, settings.assets)
    for text in contents.descriptions if contents.joints else ():
        try:
            return robot_from_urdf(text, "/robot_description", settings.assets)
        except TraceError:
            continue
    return None


def _at(times: F64, origin: int, stamps: list[int], positions: list[float]) -> F64:
    """(T,) positions at the times of the frames; the first and last one beyond them."""
    order = np.argsort(stamps, kind="stable")
    at = (np.array(stamps, np.int64) - origin)[order] * 1e-9
    return np.asarray(np.interp(times, at, np.array(positions)[order]))
