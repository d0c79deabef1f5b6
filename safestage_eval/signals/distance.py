"""Signals of where bodies are relative to each other: from poses and geometry."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from safestage_eval.geometry.cavity import containment_depth
from safestage_eval.geometry.clearance import clearance_series
from safestage_eval.geometry.mover import Mover

from .facts import Query
from .series import Series, exact

F64 = NDArray[np.float64]


def lift(query: Query) -> Series:
    """m, lowest point above the lowest point at the reference."""
    movers = shapes(query)
    if isinstance(movers, Series):
        return movers
    low = np.broadcast_to(query.facts.movers.lowest(query.groups[0][0]), len(query.episode))
    reference = query.reference
    initial = np.median(low[reference.baseline.stretch], keepdims=True)
    change = low - reference.of(low[:, None], initial)[:, 0]
    return exact(change, query.dimension, reference.baseline.notes)


def clearance(query: Query) -> Series:
    """m, distance of two unions, or of their horizontal projections; exact up to the cap."""
    movers = shapes(query)
    if isinstance(movers, Series):
        return movers
    found = clearance_series(
        movers[0],
        movers[1],
        query.cap,
        flat=query.name == "clearance_xy",
        slack=query.slack,
        deep=query.deep,
        backend=query.facts.backend,
    )
    frames = len(query.episode)
    lower, upper = (over(x, frames) for x in (found.lower, found.upper))
    return complete(query, Series(lower, upper, query.dimension))


def height_above(query: Query) -> Series:
    """m, lowest point of a union above the highest point of another."""
    movers = shapes(query)
    if isinstance(movers, Series):
        return movers
    known = query.facts.movers
    lows = [known.lowest(mover.shape.name) for mover in movers[0]]
    highs = [known.highest(mover.shape.name) for mover in movers[1]]
    value = reduce(np.minimum, lows) - reduce(np.maximum, highs)
    return complete(query, exact(over(value, len(query.episode)), query.dimension))


def containment(query: Query) -> Series:
    """m, depth of the first body's hull centroid in the second's cavity."""
    movers = shapes(query)
    if isinstance(movers, Series):
        return movers
    container = query.bodies[1]
    cavity = query.episode.bodies[container].cavity
    if cavity is None:
        return query.unknown(f"{container} has no declared cavity")
    depth = containment_depth(movers[0][0], movers[1][0], cavity)
    return exact(np.broadcast_to(depth, len(query.episode)), query.dimension)


def over(values: F64, frames: int) -> F64:
    """(T,) values, of which there may be one for all frames."""
    return values if len(values) == frames else np.broadcast_to(values, frames)


def shapes(query: Query) -> list[list[Mover]] | Series:
    """The bodies that have geometry, per argument; an unknown series where one has none."""
    movers = [query.facts.movers.of(group) for group in query.groups]
    bare = [" and ".join(g) for g, m in zip(query.groups, movers, strict=True) if not m]
    return query.unknown(f"the trace has no shape of {', '.join(bare)}") if bare else movers


def complete(query: Query, found: Series) -> Series:
    """A least value over the parts of unions, unknown from below where some have no shape."""
    unseen = [name for group in query.groups for name in query.facts.movers.unseen(group)]
    return open_below(found, unseen)


def open_below(found: Series, unseen: Sequence[str]) -> Series:
    """What bodies without a shape might make less, and nothing tells by how much."""
    if not unseen:
        return found
    note = (
        f"the trace has no shape of {', '.join(unseen)}: it may come closer than the rest "
        "(a mere frame is recorded with mass 0)"
    )
    return Series(np.full(len(found), -np.inf), found.upper, found.dimension, (*found.notes, note))
