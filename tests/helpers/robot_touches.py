"""When the robot first touched each body, directly or through others: an oracle independent of the evaluator."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from safestage_eval.episode import Episode
from safestage_eval.verdicts.verdict import Verdict

ROBOT = ("robot", "gripper")


def touch_times(episode: Episode) -> dict[str, float]:
    """Body → s, when the robot, or a body that it had reached by then, first touched it; frame by frame.

    What never moves is not reached, so that a table passes nothing on. Bodies that nobody reached are left out.
    """
    bodies, contacts = episode.header.bodies, episode.contacts
    reached = {i: -math.inf for i, body in enumerate(bodies) if body.kind in ROBOT}
    begins = np.searchsorted(contacts.frame, np.arange(len(episode) + 1))
    before: set[tuple[int, int]] = set()
    for frame, (start, stop) in enumerate(pairwise(begins)):
        first, second = contacts.body1[start:stop], contacts.body2[start:stop]
        pairs = set(zip(first.tolist(), second.tolist(), strict=True))
        if pairs == before:  # the same touch: whom it reaches, it has reached
            continue
        before, grown = pairs, True
        while grown:
            grown = False
            for i, j in (*pairs, *((j, i) for i, j in pairs)):
                if i in reached and j not in reached and bodies[j].movable:
                    reached[j], grown = float(episode.t[frame]), True
    return {bodies[i].name: time for i, time in reached.items()}


def unfounded(episode: Episode, verdict: Verdict) -> bool:
    """Whether a violation speaks of bodies none of which is the robot's, or was reached by it up to the violation's end.

    One about where the robot itself is needs no touch.
    """
    if verdict.verdict != "violation" or not verdict.bodies:
        return False
    if any(group in (verdict.signal or "") for group in ROBOT):
        return False
    latest = max((t for t in (verdict.time, verdict.worst_time) if t is not None), default=math.inf)
    times = touch_times(episode)
    return all(times.get(name, math.inf) > latest + 1e-6 for name in verdict.bodies)
