"""Invariants of motion: poses and velocities are of the same body and unit.

One function per check; each returns what it found, none of it twice.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .contradiction import ContradictionError, contradiction

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
    from .invariant_kernels import compare_motion

    if len(pose) < 2 or len(pose) != len(t) or len(velocity) != len(t) or not _some(velocity):
        return []
    hidden, out = np.zeros(0, np.bool_) if unseen is None else unseen, np.empty(5)
    compare_motion(t, pose, velocity, hidden, LONGEST[kind], WINDOW, SHAKE[kind], *JUMP[kind], out)
    by_pose, by_velocity, apart = np.sqrt(out[:3])
    what, rate, unit = WORDS[kind]
    if out[4] >= 0:
        i = int(out[4])
        return [
            contradiction(
                "jump",
                (body,),
                where,
                f"{body!r} jumps at {t[i]:.3f} s: its {what} changes otherwise than its {rate} "
                f"can explain, by more than {out[3] + JUMP[kind][0]:.3g} {unit} in one step.",
                "motion without jumps",
                "record resets as episodes of their own; look for exchanged rows or quaternions",
                time=t[i],
            )
        ]
    most = max(by_pose, by_velocity)
    if not (most > LEAST[kind] and apart > DIFFERS[kind] * most):
        return []
    ratio = by_velocity / by_pose if by_pose > 0 else np.inf
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
        )
    ]


def check_steps(
    t: F64, position: F32, body: str, where: str, unseen: Bool | None = None
) -> list[ContradictionError]:
    """(T, 3) m: no step that nothing could have moved a body over; for bodies without velocities."""
    from .invariant_kernels import longest_step

    if len(position) < 2 or len(position) != len(t):
        return []
    hidden, out = np.zeros(0, np.bool_) if unseen is None else unseen, np.empty(2)
    longest_step(t, position, hidden, LONGEST["position"], FASTEST, out)
    i = int(out[1])
    if i < 0 or not out[0] > JUMP["position"][0]:
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
        )
    ]


def check_above_floor(
    position: F32, floor: F32, radius: float, body: str, plane: str, t: F64, where: str
) -> list[ContradictionError]:
    """(T, 3) m: a body of that radius does not lie below an infinite horizontal plane."""
    if not len(position) or not position[:, 2].min() < float(floor[0, 2]) - radius - 0.05:
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
        )
    ]


def _some(column: F32) -> bool:
    """Not zero throughout."""
    if column[len(column) // 2].any():  # mostly; then the rest need not be looked at
        return True
    with np.errstate(all="ignore"):
        return bool(column.max() != 0 or column.min() != 0)
