"""How far a held body has slipped in the hand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.geometry.pose import inverse_transform
from safestage_eval.signals.motion import com_position
from safestage_eval.signals.reference import Reference
from safestage_eval.signals.series import Series, exact, unknown


def slip(
    episode: Episode, name: str, held: NDArray[np.bool_] | None, reference: Reference | None
) -> Series:
    """(T,) m, drift of the COM in the gripper's frame since the body was last grasped.

    While it is not held nothing has slipped: 0. With a reference, since its event, once there was
    one: ``since`` the start of a state that bridges gaps keeps measuring where a finger lets go
    for a moment.

    Args:
        episode: where it moves.
        name: of the body.
        held: (T,) where the gripper holds it; None where that is not known.
        reference: the frame to measure from, instead of the grasp.
    """
    frames = len(episode)
    if held is None:
        return unknown(frames, "length", f"the trace does not tell when {name} is held")
    hand = gripper_frame(episode)
    if hand is None:
        return unknown(frames, "length", "the trace does not say which body is the gripper")
    track = episode.track(hand)
    there = inverse_transform(track.position, track.orientation, com_position(episode, name))
    begins = held & ~np.concatenate([np.zeros(1, np.bool_), held[:-1]])
    since = np.maximum.accumulate(np.where(begins, np.arange(frames), 0))
    if reference is not None and reference.since is not None:
        since = np.where(reference.since < 0, since, reference.since)
    drift = np.linalg.norm(there - there[since], axis=1)
    return exact(np.where(held, drift, 0.0), "length")


def gripper_frame(episode: Episode) -> str | None:
    """The body that carries the tool centre point, or the nearest that bears both fingers.

    Else the only body of the gripper, if there is just one.
    """
    bodies = episode.bodies
    tools = [body.name for body in bodies.values() if body.tcp is not None]
    if tools:
        return tools[0] if len(tools) == 1 else None
    lines = [_line(episode, body.name) for body in bodies.values() if body.finger is not None]
    if not lines:
        grippers = [b.name for b in bodies.values() if b.kind == "gripper" and b.movable]
        return grippers[0] if len(grippers) == 1 else None
    return next((name for name in lines[0] if all(name in line for line in lines)), None)


def _line(episode: Episode, name: str) -> list[str]:
    """A body and all that it hangs on, from near to far."""
    line: list[str] = []
    following: str | None = name
    while following in episode.bodies and following not in line:
        line.append(following)
        following = episode.bodies[following].parent
    return line
