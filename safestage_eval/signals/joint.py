"""Signals of joints, of the robot and of drawers, doors and lids; and the gripper's opening."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from safestage_eval.evidence.declare import Option, signal
from safestage_eval.evidence.intervals import Interval

if TYPE_CHECKING:
    from safestage_eval.episode import Joint
    from safestage_eval.evidence.facts import Request

SPEED_UNIT = Option(
    "unit",
    "unit",
    "rad/s for joints that turn, m/s for those that slide.",
    choices=("rad/s", "m/s"),
)
FORCE_UNIT = Option(
    "unit", "unit", "N m for joints that turn, N for those that slide.", choices=("N m", "N")
)

_KIND_OF = {"rad/s": "revolute", "N m": "revolute", "m/s": "prismatic", "N": "prismatic"}
_MOVES = {"revolute": "turns", "prismatic": "slides"}


@signal(
    "joint_torque", "torque", args=("j",), needs=("joints",), scale=1.0, options=(FORCE_UNIT,),
    joints=True, reads="",
)  # fmt: skip
def joint_torque(request: Request) -> Interval:
    """Torque of the joint's actuator, with its sign.

    N m; N where the variant says so.
    """
    pair = _joint(request, "N m")
    if isinstance(pair, Interval):
        return pair
    number, _ = pair
    recorded = request.episode.frames.joint_torque
    if not recorded.shape[1]:
        return request.unknown("the trace has no joint torques")
    return request.exact(recorded[:, number])


@signal(
    "joint_speed", "rate", args=("j",), needs=("joints",), scale=0.1, options=(SPEED_UNIT,),
    joints=True, reads="", ahead=True,
)  # fmt: skip
def joint_speed(request: Request) -> Interval:
    """Velocity of the joint, with its sign.

    rad/s; m/s where the variant says so. Derived from positions where no velocity was recorded.
    """
    pair = _joint(request, "rad/s")
    if isinstance(pair, Interval):
        return pair
    number, joint = pair
    frames = request.episode.frames
    if frames.joint_velocity.shape[1]:
        return request.exact(frames.joint_velocity[:, number])
    if not frames.joint_position.shape[1] or len(request.episode) < 2:
        return request.unknown("the trace has no joint velocities")
    position = frames.joint_position[:, number].astype(np.float64)
    value = np.gradient(position, request.episode.t)
    note = f"the trace has no velocity of {joint.name}: it is derived from its positions"
    return request.exact(value, (note,))


@signal(
    "joint_opening", "ratio", args=("j",), needs=("joints",), scale=0.1, joints=True, reads="",
)  # fmt: skip
def joint_opening(request: Request) -> Interval:
    """Position between the joint's limits: 0 closed (the limit nearer to zero) … 1 open.

    Closed is the limit nearer to zero, where models put a drawer or door that is shut; the lower
    one if both are equally far. A door with limits −1.57 … 0 rad is closed at 0.
    """
    pair = _joint(request, "")
    if isinstance(pair, Interval):
        return pair
    number, joint = pair
    recorded = request.episode.frames.joint_position
    if not recorded.shape[1]:
        return request.unknown("the trace has no joint positions")
    if joint.limits is None or not joint.limits[0] < joint.limits[1]:
        return request.unknown(f"the trace has no limits of {joint.name}")
    low, high = joint.limits
    share = (recorded[:, number].astype(np.float64) - low) / (high - low)
    return request.exact(share if abs(low) <= abs(high) else 1 - share)


@signal("gripper_opening", "ratio", args=(), needs=("gripper",), scale=0.1, reads="")
def gripper_opening(request: Request) -> Interval:
    """0 closed … 1 open."""
    recorded = request.episode.frames.gripper
    if not recorded.shape[1]:
        return request.unknown("the trace has no gripper opening")
    return request.exact(recorded[:, 0])


def _joint(request: Request, usual: str) -> tuple[int, Joint] | Interval:
    """The joint of this name, or the only one that moves the body of this name.

    ``usual`` is the unit that is meant where the variant names none; empty for any joint.
    """
    name, joints = request.bodies[0], request.episode.header.joints
    of_name = [(i, joint) for i, joint in enumerate(joints) if joint.name == name]
    of_name = of_name or [(i, joint) for i, joint in enumerate(joints) if joint.body == name]
    if len(of_name) != 1:
        named = ", ".join(joint.name for _, joint in of_name)
        return request.unknown(
            f"{name} has {f'several joints: {named}' if of_name else 'no joint'}"
        )
    joint, unit = of_name[0][1], str(request.option("unit") or usual)
    if unit and joint.kind != _KIND_OF[unit]:
        moves, other = _MOVES[joint.kind], _MOVES[_KIND_OF[unit]]
        return request.unknown(f"{joint.name} {moves}; {request.name} in {unit} is of what {other}")
    return of_name[0]
