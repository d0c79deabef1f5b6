"""Checks of the robot's joints and gripper."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode.contradiction import ContradictionError, doubt
from safestage_eval.episode.rounding import most_off

from .check_registry import check
from .columns import Columns
from .motion_doubts import DIFFERS, LEAST, LONGEST


@check(
    "AUD141",
    "error",
    title="joints are outside their limits",
    why="Openings of drawers and lids, and joint limits, are judged in rad and m.",
    example="joint positions in degrees",
    over="columns",
)
def joint_ranges(columns: Columns) -> Iterator[ContradictionError]:
    """Compares joint positions with the limits of the joints, and a tenth more for soft ones."""
    frames = columns.at_hand.frames()
    for i, joint in enumerate(columns.header.joints if frames is not None else ()):
        if frames is None or joint.limits is None or i >= frames.joint_position.shape[1]:
            continue
        low, high = joint.limits
        values, slack = frames.joint_position[:, i], 0.1 * (high - low) + 0.05
        with np.errstate(over="ignore"):  # a limit may be larger than any float32
            off = (values < low - slack) | (values > high + slack)
        if high > low and off.any():
            unit = "rad" if joint.kind == "revolute" else "m"
            yield doubt(
                f"joint {joint.name!r} is at {values[off][0]:.4g} {unit} in {int(off.sum())} "
                f"frames, its limits are {low:.4g} to {high:.4g}.",
                "rad or m, in the order of the header's joints",
                "look for degrees, mm, or another order of the joints",
                bodies=(joint.name,),
                hides=("joint",),
            )


@check(
    "AUD142",
    "error",
    title="joint velocities are not those of the positions",
    why="Speeds of joints are judged by the velocities.",
    example="joint velocities in degrees per second, or in another order",
    unless=("AUD141",),
    over="columns",
)
def joint_velocities(columns: Columns) -> Iterator[ContradictionError]:
    """Adds up joint velocities and compares them with the change of the positions."""
    frames, t, joints = columns.at_hand.frames(), columns.t, columns.header.joints
    if frames is None:
        return
    place, rate = (a.astype(np.float64) for a in (frames.joint_position, frames.joint_velocity))
    dt = np.diff(t)
    if place.shape != rate.shape or len(t) < 2 or dt.max() > LONGEST["orientation"]:
        return
    parts = np.arange(0, len(t), max(1, round(0.25 / float(dt.mean()))))
    went = np.add.reduceat(np.diff(place, axis=0, prepend=place[:1]), parts)
    steps = np.concatenate([np.zeros_like(rate[:1]), (rate[1:] + rate[:-1]) / 2 * dt[:, None]])
    said = np.add.reduceat(steps, parts)
    by_place, by_rate = (np.sqrt(np.nansum(a * a, 0)) for a in (went, said))
    kind, most = "orientation", np.maximum(by_place, by_rate)

    def differ(off: float) -> NDArray[np.bool_]:
        beyond = np.maximum(np.abs(went - said) - off, 0)
        apart = np.sqrt(np.nansum(beyond * beyond, 0))
        return np.asarray((most > LEAST[kind]) & (apart > DIFFERS[kind] * most) & (by_rate > 0))

    wrong = differ(0.0)
    if wrong.any():
        wrong = differ(2 * most_off(frames.joint_position) + 0.25 * most_off(frames.joint_velocity))
    for i in np.flatnonzero(wrong).tolist():
        yield doubt(
            f"the velocity of joint {joints[i].name!r} is not that of its position: the one says "
            f"{by_rate[i]:.3g}, the other {by_place[i]:.3g}.",
            "rad and rad/s, or m and m/s",
            "look for degrees, another order of the joints, or another sign",
            bodies=(joints[i].name,),
            hides=("joint",),
        )


@check(
    "AUD143",
    "error",
    title="the gripper's opening is not between 0 and 1",
    why="0 is closed and 1 is open; where forces are missing, grips are decided from it.",
    example="an opening in metres times 100, or in percent",
    over="columns",
)
def opening(columns: Columns) -> Iterator[ContradictionError]:
    """Compares the opening with 0 and 1."""
    frames = columns.at_hand.frames()
    if frames is None:
        return
    off = (frames.gripper < -0.05) | (frames.gripper > 1.05)
    if off.any():
        yield doubt(
            f"the gripper's opening is {frames.gripper[off][0]:.4g}.",
            "0 (closed) to 1 (open)",
            "divide its width by the greatest one",
            hides=("gripper",),
        )
