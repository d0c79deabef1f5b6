"""How far a held body has slipped in the hand."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.declare import signal
from safestage_eval.evidence.intervals import Interval, exact, hide, unknown

if TYPE_CHECKING:
    from safestage_eval.episode import Episode
    from safestage_eval.evidence.facts import Request
    from safestage_eval.evidence.reference import Reference


@signal("slip", "length", args=("a",), needs=("poses", "touch"), since=True, reads="", support=True)
def slip(request: Request) -> Interval:
    """How far the centre of mass went in the gripper's frame since it was grasped.

    m. Unknown after frames that were not recorded: the grasp may have been lost in them. What is held
    because it moves along with the gripper cannot slip, so such a grip does not tell.
    """
    relations, body = request.relations, request.bodies[0]
    decidable = relations.fingers_seen or not relations.blind
    held = relations.told("held", [body]).lower > 0 if decidable else None
    drift = drift_of(request.episode, body, held, request.since)
    if decidable:
        drift = replace(drift, notes=(*drift.notes, *relations.caveat("held")))
    unseen = request.episode.unseen
    return drift if unseen is None else hide(drift, np.logical_or.accumulate(unseen))


def drift_of(
    episode: Episode, name: str, held: NDArray[np.bool_] | None, reference: Reference | None
) -> Interval:
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
    from safestage_eval.evidence.motion import com_position
    from safestage_eval.geometry.pose import inverse_transform
    from safestage_eval.relations.held import gripper_frame

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
