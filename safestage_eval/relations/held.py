"""Whether the gripper holds a body: by forces, by shapes, or by how the two move together."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.geometry.pose import angle, relative

Bool = NDArray[np.bool_]

STAYS = 5e-3
"""m. A held body's origin stays within this of where it was in the gripper's frame …"""
STAYS_TURN = 0.1
"""rad. … and its orientation within this."""
CARRIED_OFF = 0.02
"""m. The gripper moves by at least this meanwhile: what merely lies near a still hand is not held."""
HOVERS = 0.1
"""s. What stays so long beside the gripper and rests on nothing may be held: it does not fall."""
MOVES = 1e-4
"""m. A gripper that goes less than this in one frame rests."""


class Grip(NamedTuple):
    """(T,) each, about one body.

    Attributes:
        sure: it is certainly held.
        perhaps: it may be: from when it first went along.
        grasped: the hand stays with it, and takes it along sooner or later: it may be about to.
    """

    sure: Bool
    perhaps: Bool
    grasped: Bool


def by_fingers(
    episode: Episode, body: int, beside: Iterable[int], touching: Callable[[int, int], Bool]
) -> Bool:
    """(T,) true where a left and a right finger touch the body.

    Args:
        episode: whose bodies these are.
        body: index into ``header.bodies``.
        beside: the bodies that ever touch it.
        touching: (T,) for two bodies.
    """
    touched = {side: np.zeros(len(episode), np.bool_) for side in ("left", "right")}
    for other in beside:
        finger = episode.header.bodies[other].finger
        if finger is not None and other != body:
            touched[finger] |= touching(body, other)
    return touched["left"] & touched["right"]


def by_motion(episode: Episode, body: int, hand: str, supported: Bool) -> Grip:
    """Where the body goes along with the gripper.

    The episode is cut where the body's pose in the gripper's frame has left that at the start of
    the stretch. In a stretch in which the gripper moves away by ``CARRIED_OFF`` the body is held
    from the gripper's first move to its last, and as long as nothing else bears it. After that a
    hand that stays may still have it in its grip or not; so may one that has not gone far yet, with
    what nothing else bears.

    Args:
        episode: where both move.
        body: index into ``header.bodies``.
        hand: the gripper's name.
        supported: (T,) where something but the robot bears the body.
    """
    name, frames = episode.header.bodies[body].name, len(episode)
    track, grip = episode.track(name), episode.track(hand)
    place, turn = relative(grip.position, grip.orientation, track.position, track.orientation)
    path = grip.position.astype(np.float64)
    goes = np.linalg.norm(np.diff(path, axis=0), axis=1) > MOVES
    held, perhaps, grasped = (np.zeros(frames, np.bool_) for _ in range(3))
    start = 0
    while start < frames:
        left = np.linalg.norm(place[start:] - place[start], axis=1) > STAYS
        left |= angle(turn[start:], turn[start]) > STAYS_TURN
        stop = start + int(left.argmax()) if left.any() else frames
        away = np.linalg.norm(path[start:stop] - path[start], axis=1).max()
        moves = np.flatnonzero(goes[start : max(stop - 1, start)])
        if away >= CARRIED_OFF and len(moves):
            first, last = start + int(moves[0]), start + int(moves[-1]) + 2
            held[first:last] = True
            held[start:stop] |= ~supported[start:stop]
            perhaps[start:stop] |= held[start:stop]
            perhaps[first:stop] = True
            grasped[start:stop] = True
        elif episode.clock.seconds(start, stop) >= HOVERS and not supported[start:stop].all():
            perhaps[start:stop] |= ~supported[start:stop]
            grasped[start:stop] = True
        start = stop
    return Grip(held, perhaps, grasped)
