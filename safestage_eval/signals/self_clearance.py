"""The signal of how near the robot comes to itself."""

from __future__ import annotations

from safestage_eval.episode import Body, Episode
from safestage_eval.geometry.clearance import clearance_pairs
from safestage_eval.geometry.mover import Mover

from .distance import open_below
from .facts import Facts, Query
from .series import Series


def pairs(episode: Episode) -> list[tuple[str, str]]:
    """The bodies of the robot that may collide with each other, each pair once.

    Not those that the model excludes, neighbours along a joint, the left and the right finger
    (they are made to meet), and two that never move.
    """
    return [(a.name, b.name) for a, b in _facing(episode) if a.geoms and b.geoms]


def facing(facts: Facts) -> list[tuple[Mover, Mover]]:
    """The same pairs as shapes."""
    return [(facts.movers[a], facts.movers[b]) for a, b in pairs(facts.episode)]


def clearance(query: Query) -> Series:
    """m, least over the pairs; exact up to the cap."""
    seen = facing(query.facts)
    if not seen:
        return query.unknown("the trace has no two bodies of a robot that may collide")
    # the nearest pairs first: what is farther off than they are need not be known exactly
    nearest_first = sorted(seen, key=_gap_at_start)
    distance = clearance_pairs(
        nearest_first,
        len(query.episode),
        query.cap,
        slack=query.slack,
        deep=query.deep,
        backend=query.facts.backend,
    )
    found = Series(distance.lower, distance.upper, query.dimension)
    unseen = {body.name for pair in _facing(query.episode) for body in pair if body.unseen}
    return open_below(found, sorted(unseen))


def _facing(episode: Episode) -> list[tuple[Body, Body]]:
    parts = [body for body in episode.header.bodies if body.kind in ("robot", "gripper")]
    return [
        (a, b)
        for i, a in enumerate(parts)
        for b in parts[i + 1 :]
        if (a.movable or b.movable) and not _ignored(a, b)
    ]


def _gap_at_start(pair: tuple[Mover, Mover]) -> float:
    a, b = (Mover.build(m.shape, m.position[0], m.orientation[0]) for m in pair)
    return float(clearance_pairs([(a, b)], 1).lower[0])


def _ignored(a: Body, b: Body) -> bool:
    jointed = a.parent == b.name or b.parent == a.name
    excluded = b.name in a.excluded or a.name in b.excluded
    return jointed or excluded or {a.finger, b.finger} == {"left", "right"}
