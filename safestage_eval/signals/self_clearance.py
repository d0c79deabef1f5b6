"""The signal of how near the robot comes to itself."""

from __future__ import annotations

import numpy as np

from safestage_eval.episode import Body, Episode
from safestage_eval.geometry.clearance import clearance_series
from safestage_eval.geometry.mover import Mover

from .facts import Facts, Query
from .series import Series


def pairs(episode: Episode) -> list[tuple[str, str]]:
    """The bodies of the robot that may collide with each other, each pair once.

    Not those that the model excludes, neighbours along a joint, the left and the right finger
    (they are made to meet), and two that never move.
    """
    parts = [body for body in episode.header.bodies if body.kind in ("robot", "gripper")]
    return [
        (a.name, b.name)
        for i, a in enumerate(parts)
        for b in parts[i + 1 :]
        if a.geoms and b.geoms and (a.movable or b.movable) and not _ignored(a, b)
    ]


def facing(facts: Facts) -> list[tuple[Mover, list[Mover]]]:
    """The same as shapes: each body with all that it is compared with."""
    others: dict[str, list[Mover]] = {}
    for a, b in pairs(facts.episode):
        others.setdefault(a, []).append(facts.movers[b])
    return [(facts.movers[a], movers) for a, movers in others.items()]


def clearance(query: Query) -> Series:
    """m, least over the pairs; exact up to the cap."""
    found = facing(query.facts)
    if not found:
        return query.unknown("the trace has no two bodies of a robot that may collide")
    frames = len(query.episode)
    lower, upper = np.full(frames, np.inf), np.full(frames, np.inf)
    for mover, others in found:
        distance = clearance_series([mover], others, query.cap)
        lower, upper = np.minimum(lower, distance.lower), np.minimum(upper, distance.upper)
    return Series(lower, upper, query.dimension)


def _ignored(a: Body, b: Body) -> bool:
    jointed = a.parent == b.name or b.parent == a.name
    excluded = b.name in a.excluded or a.name in b.excluded
    return jointed or excluded or {a.finger, b.finger} == {"left", "right"}
