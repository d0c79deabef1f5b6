"""Signals of joints: of the robot, and of articulated fixtures such as drawers and doors."""

from __future__ import annotations

import numpy as np

from safestage_eval.episode import Joint

from .facts import Query
from .series import Series, exact

_KIND_OF = {"rad/s": "revolute", "N m": "revolute", "m/s": "prismatic", "N": "prismatic"}
_MOVES = {"revolute": "turns", "prismatic": "slides"}


def torque(query: Query) -> Series:
    """N m (N where the variant says so), by the actuators, with its sign."""
    found = _joint(query, "N m")
    if isinstance(found, Series):
        return found
    number, _ = found
    recorded = query.episode.frames.joint_torque
    if not recorded.shape[1]:
        return query.unknown("the trace has no joint torques")
    return exact(recorded[:, number], query.dimension)


def speed(query: Query) -> Series:
    """rad/s (m/s where the variant says so), with its sign; from positions if there is no other."""
    found = _joint(query, "rad/s")
    if isinstance(found, Series):
        return found
    number, joint = found
    frames = query.episode.frames
    if frames.joint_velocity.shape[1]:
        return exact(frames.joint_velocity[:, number], query.dimension)
    if not frames.joint_position.shape[1] or len(query.episode) < 2:
        return query.unknown("the trace has no joint velocities")
    position = frames.joint_position[:, number].astype(np.float64)
    value = np.gradient(position, query.episode.t)
    note = f"the trace has no velocity of {joint.name}: it is derived from its positions"
    return exact(value, query.dimension, (note,))


def opening(query: Query) -> Series:
    """Position between the limits: 0 closed … 1 open.

    Closed is the limit nearer to zero, where models put a drawer or door that is shut; the lower
    one if both are equally far. A door with limits −1.57 … 0 rad is closed at 0.
    """
    found = _joint(query, "")
    if isinstance(found, Series):
        return found
    number, joint = found
    recorded = query.episode.frames.joint_position
    if not recorded.shape[1]:
        return query.unknown("the trace has no joint positions")
    if joint.limits is None or not joint.limits[0] < joint.limits[1]:
        return query.unknown(f"the trace has no limits of {joint.name}")
    low, high = joint.limits
    share = (recorded[:, number].astype(np.float64) - low) / (high - low)
    return exact(share if abs(low) <= abs(high) else 1 - share, query.dimension)


def _joint(query: Query, usual: str) -> tuple[int, Joint] | Series:
    """The joint of this name, or the only one that moves the body of this name.

    ``usual`` is the unit that is meant where the variant names none; empty for any joint.
    """
    name, joints = query.bodies[0], query.episode.header.joints
    found = [(i, joint) for i, joint in enumerate(joints) if joint.name == name]
    found = found or [(i, joint) for i, joint in enumerate(joints) if joint.body == name]
    if len(found) != 1:
        named = ", ".join(joint.name for _, joint in found)
        return query.unknown(f"{name} has {f'several joints: {named}' if found else 'no joint'}")
    joint, unit = found[0][1], str(query.option("unit") or usual)
    if unit and joint.kind != _KIND_OF[unit]:
        moves, other = _MOVES[joint.kind], _MOVES[_KIND_OF[unit]]
        return query.unknown(f"{joint.name} {moves}; {query.name} in {unit} is of what {other}")
    return found[0]
