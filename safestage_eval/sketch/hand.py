"""The gripper of a sketch: a hand and two fingers that go where the story needs them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Geom, Tcp
from safestage_eval.geometry.pose import compose, conjugate, product, rotate

F64 = NDArray[np.float64]

FINGER = (0.01, 0.01, 0.03)
"""m, half lengths of a finger."""
PALM = (0.04, 0.05, 0.03)
"""m, half lengths of the hand above the fingers."""
WAITING = (-0.5, 0.0, 0.6)
"""m, world: where it waits."""
CLEAR = 0.2
"""m: it comes from, and leaves to, so far above."""
TRAVEL = 0.5
"""s that coming down and going up take."""
SLACK = 0.02
"""m by which each finger is further out when it does not hold."""
WIDEST = 0.0425
"""m from the middle to an open finger: what counts as fully open."""
NAMES = ("hand", "finger_left", "finger_right")
_HALF = float(np.sqrt(0.5))
_ACROSS = {"y": (1.0, 0.0, 0.0, 0.0), "x": (_HALF, 0.0, 0.0, -_HALF)}


@dataclass(frozen=True, eq=False)
class Visit:
    """The gripper's stay at one place.

    Attributes:
        first, last: s.
        position: (T, 3) m, world: the point between the finger tips, at every frame.
        orientation: (T, 4) wxyz: how it has turned with what it holds since it came.
        opening: m from that point to each finger's inner face.
        across: world axis, x or y, along which the fingers close as it comes.
    """

    first: float
    last: float
    position: F64
    orientation: F64
    opening: float
    across: str = "y"


def bodies() -> list[Body]:
    """Make hand and fingers. The fingers' inner faces touch y = 0 of their frames at the tips' height."""
    finger = Geom(kind="box", size=FINGER, position=(0.0, 0.0, FINGER[2] - 0.01))
    palm = Geom(kind="box", size=PALM, position=(0.0, 0.0, 2 * FINGER[2] - 0.01 + PALM[2]))
    tcp = Tcp(position=(0.0, 0.0, 0.0), orientation=(0.0, _HALF, _HALF, 0.0))
    return [
        Body(name="hand", kind="gripper", mass=0.5, geoms=(palm,), tcp=tcp, excluded=NAMES[1:]),
        Body(name="finger_left", kind="gripper", mass=0.1, finger="left", geoms=(finger,),
             parent="hand", excluded=("hand", "finger_right")),
        Body(name="finger_right", kind="gripper", mass=0.1, finger="right", geoms=(finger,),
             parent="hand", excluded=("hand", "finger_left")),
    ]  # fmt: skip


def follow(t: F64, visits: Sequence[Visit]) -> tuple[dict[str, tuple[F64, F64]], F64]:
    """Compute the poses of the three bodies and the opening.

    Args:
        t: (T,) s.
        visits: in the order of time, not overlapping.

    Returns:
        name → position (T, 3) m and orientation (T, 4), world; and (T,) 0 closed … 1 open.
    """
    position, orientation = _way(t, visits)
    opening = np.full(len(t), WIDEST)
    for visit in visits:
        near = (t >= visit.first - TRAVEL / 2) & (t <= visit.last + TRAVEL / 2)
        there = (t >= visit.first - 1e-9) & (t <= visit.last + 1e-9)
        opening[near] = visit.opening + SLACK
        opening[there] = visit.opening
    poses = {"hand": (position, orientation)}
    for name, sign in (("finger_left", 1.0), ("finger_right", -1.0)):
        out = np.zeros((len(t), 3))
        out[:, 1] = sign * (opening + FINGER[1])
        poses[name] = compose(position, orientation, out, (1.0, 0.0, 0.0, 0.0))
    return poses, np.clip(opening / WIDEST, 0, 1)


def _way(t: F64, visits: Sequence[Visit]) -> tuple[F64, F64]:
    """Go from above to each place, along with it, up again, and over to the next."""
    knots: list[tuple[float, F64]] = []
    if not visits or visits[0].first > 0:
        knots.append((0.0, np.array(WAITING)))
    position = np.empty((len(t), 3))
    orientation = np.tile([1.0, 0.0, 0.0, 0.0], (len(t), 1))
    up = np.array([0, 0, CLEAR])
    for i, visit in enumerate(visits):
        room = visit.first - (visits[i - 1].last if i else 0.0)
        start, stop = (
            visit.position[min(int(np.searchsorted(t, time - 1e-9)), len(t) - 1)]
            for time in (visit.first, visit.last)
        )
        if room > 1e-6:
            knots.append((visit.first - min(TRAVEL, room / 3), start + up))
        knots += [(visit.first, start), (visit.last, stop)]
        leave = visits[i + 1].first - visit.last if i + 1 < len(visits) else 3 * TRAVEL
        if leave > 1e-6:
            knots.append((visit.last + min(TRAVEL, leave / 3), stop + up))
    times = np.array([time for time, _ in knots])
    points = np.array([point for _, point in knots])
    for axis in range(3):
        position[:, axis] = np.interp(t, times, points[:, axis])
    for visit in visits:
        there = (t >= visit.first - 1e-9) & (t <= visit.last + 1e-9)
        position[there] = visit.position[there]
        side = np.array(_ACROSS[visit.across])
        orientation[there] = product(visit.orientation[there], side)
        before = (t < visit.first) & (t >= visit.first - TRAVEL)
        after = (t > visit.last) & (t <= visit.last + TRAVEL)
        orientation[before | after] = side
    return position, orientation


def carried_along(position: F64, orientation: F64, frame: int, point: F64) -> tuple[F64, F64]:
    """Move a world point (3,) along with a body from a frame on: (T, 3) m and its turn (T, 4)."""
    local = rotate(conjugate(orientation[frame]), point - position[frame])
    turned = product(orientation, np.broadcast_to(conjugate(orientation[frame]), orientation.shape))
    return position + rotate(orientation, np.broadcast_to(local, position.shape)), turned
