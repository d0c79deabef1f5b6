"""Invariants of motion: poses and velocities are of the same body and unit.

One function per check; each returns what it found, none of it twice.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .column_comparisons import compare_motion, longest_step
from .contradiction import POSES, Column, ContradictionError, contradiction
from .rounding import most_off

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

WINDOW = 0.25
"""s over which motion is added up before it is compared: a body that chatters at rest has fast
velocities that come to nothing."""

LONGEST = {"position": 0.1, "orientation": 0.009}
"""s; from velocities further apart nobody can tell how a body moved in between. A mechanism vibrates
at the rate of its controller (60 Hz in recorded episodes): sampled at 60 Hz or slower, its angular
velocity says nothing of its turns. A thing in a gripper may shake with the period of two or four
physics steps: sampled at 100 Hz its angular velocity is always that of one side of the shake."""

SHAKE = {"position": 0.1, "orientation": 0.4}
"""m/s and rad/s by which velocities may say more than poses. A hand that presses a thing onto something
shakes with the period of four physics steps: recorded at 120 Hz, its angular velocity is for seconds that
of one side of the shake, 0.3 rad/s, while it hardly turns. A mug that rattles between two fingers (Meta-World,
100 Hz) is up to 0.1 m/s faster than its way."""

LEAST = {"position": 0.05, "orientation": 0.2}
"""m and rad (root of the sum of squares over windows): less motion is not compared."""

DIFFERS = {"position": 0.45, "orientation": 0.6}
"""Share of the motion by which poses and velocities may differ. In recorded episodes it is .09 and
.31 at the most, thinned to 10 Hz .31 of positions. Velocities mirrored differ by 2, ten times too
large by .9, twice by .5; those of another body, or of quaternions in another order, by about 1."""

JUMP = {"position": (0.05, 5.0), "orientation": (1.0, 50.0)}
"""m and m/s, rad and rad/s: how far a step may lead from where velocities do. No collision changes
a speed by more than 10 m/s, and half of that acts over the step; recorded episodes stay below 1 cm
and 0.13 rad."""

FASTEST = 20.0
"""m/s; of a body without velocities, a step beyond (and 5 cm) is no motion. It has fallen from 20 m."""

NOISY = (0.8, 1.25)
"""Share of the poses' motion that the velocities hold where they are that motion with noise (PhysX): poses
are believed then. Other units, axes, signs and bodies give other shares."""

MOTION: tuple[Column, ...] = (*POSES, "linear_velocity", "angular_velocity")
RATES: dict[str, tuple[Column, ...]] = {
    "position": ("linear_velocity",),
    "orientation": ("angular_velocity",),
}

WORDS = {
    "position": ("position", "linear velocity", "m"),
    "orientation": ("orientation", "angular velocity", "rad"),
}


def check_velocities(
    t: F64, pose: F32, velocity: F32, kind: str, body: str, where: str, unseen: Bool | None = None
) -> list[ContradictionError]:
    """Poses change as the velocities say; a velocity that is zero throughout was not recorded.

    Args:
        t: (T,) s.
        pose: (T, 3) m or (T, 4) wxyz.
        velocity: (T, 3) m/s or rad/s, of the body frame's origin, world.
        kind: ``position`` or ``orientation``.
        body: for messages.
        where: likewise.
        unseen: (T,) frames to leave out.
    """
    if len(pose) < 2 or len(pose) != len(t) or len(velocity) != len(t) or not _some(velocity):
        return []
    motion = compare_motion(t, pose, velocity, unseen, LONGEST[kind], WINDOW)
    over, i = motion.beyond(*JUMP[kind])
    by_pose, by_velocity, apart = motion.sizes(SHAKE[kind])
    if i >= 0 or _differ(by_pose, by_velocity, apart, kind=kind):
        off = 2 * most_off(pose) * (1 if kind == "position" else 2)
        over, i = motion.beyond(JUMP[kind][0] + off, JUMP[kind][1])
        off += WINDOW * most_off(velocity)
        by_pose, by_velocity, apart = motion.sizes(SHAKE[kind], off)
    what, rate, unit = WORDS[kind]
    if i >= 0:
        return [
            contradiction(
                "jump",
                (body,),
                where,
                f"{body!r} jumps at {t[i]:.3f} s: its {what} changes otherwise than its {rate} "
                f"can explain, by more than {over + JUMP[kind][0]:.3g} {unit} in one step.",
                "motion without jumps",
                "record resets as episodes of their own; look for exchanged rows or quaternions",
                time=t[i],
                hides=MOTION,
            )
        ]
    if not _differ(by_pose, by_velocity, apart, kind=kind):
        return []
    ratio = by_velocity / by_pose if by_pose > 0 else np.inf
    # velocities = k · motion of the poses + noise across it
    k = (by_pose**2 + by_velocity**2 - apart**2) / (2 * by_pose**2) if by_pose > LEAST[kind] else 0
    noisy = NOISY[0] <= k <= NOISY[1]
    return [
        contradiction(
            f"{kind} velocity",
            (body,),
            where,
            f"the {rate} of {body!r} is not that of its {what}: the one says {by_velocity:.3g}, "
            f"the other {by_pose:.3g} {unit} (ratio {ratio:.3g}), and they differ by {apart:.3g}.",
            "velocities of the body frame's origin in the world, m/s and rad/s; quaternions wxyz",
            "look for other units, axes, a body-fixed frame, another body's column, or xyzw; "
            "or leave velocities out (NaN): they are then derived from the poses",
            hides=MOTION if not noisy else RATES[kind],
        )
    ]


def _differ(by_pose: float, by_velocity: float, apart: float, *, kind: str) -> bool:
    most = max(by_pose, by_velocity)
    return most > LEAST[kind] and apart > DIFFERS[kind] * most


def check_steps(
    t: F64, position: F32, body: str, where: str, unseen: Bool | None = None
) -> list[ContradictionError]:
    """(T, 3) m: no step that nothing could have moved a body over; for bodies without velocities."""
    if len(position) < 2 or len(position) != len(t):
        return []
    over, i = longest_step(t, position, unseen, LONGEST["position"], FASTEST)
    least = JUMP["position"][0]
    if i < 0 or not (over > least and over > least + 2 * most_off(position)):
        return []
    went, dt = float(np.linalg.norm(position[i] - position[i - 1])), t[i] - t[i - 1]
    return [
        contradiction(
            "jump",
            (body,),
            where,
            f"{body!r} jumps by {went:.3g} m at {t[i]:.3f} s, within {dt:.3g} s.",
            "motion without jumps",
            "record resets as episodes of their own; look for exchanged rows",
            time=t[i],
            hides=MOTION,
        )
    ]


def check_above_floor(
    position: F32, floor: F32, radius: float, body: str, plane: str, t: F64, where: str
) -> list[ContradictionError]:
    """(T, 3) m: a body of that radius does not lie below an infinite horizontal plane."""
    if not len(position) or not position[:, 2].min() < float(floor[0, 2]) - radius - 0.05:
        return []
    if not position[:, 2].min() < float(floor[0, 2]) - radius - 0.05 - most_off(position):
        return []
    i = int(position[:, 2].argmin())
    return [
        contradiction(
            "floor",
            (body,),
            where,
            f"{body!r} is {floor[0, 2] - position[i, 2]:.3g} m below the floor {plane!r} at "
            f"{t[min(i, len(t) - 1)]:.3f} s.",
            "nothing below a plane, which is a half-space",
            "look for another unit or axis of the poses; or it fell through in the simulation",
            time=t[min(i, len(t) - 1)],
            hides=MOTION,
        )
    ]


def _some(column: F32) -> bool:
    """Not zero throughout."""
    if column[len(column) // 2].any():  # mostly; then the rest need not be looked at
        return True
    with np.errstate(all="ignore"):
        return bool(column.max() != 0 or column.min() != 0)
