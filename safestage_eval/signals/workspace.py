"""The signal of the room that a body may be in."""

from __future__ import annotations

import numpy as np

from safestage_eval.geometry.extent import reach

from .distance import complete, shapes
from .facts import Query
from .series import Series, exact


def margin(query: Query) -> Series:
    """m, of all geometry to the nearest face of the box; negative: how far it is beyond one."""
    movers = shapes(query)
    if isinstance(movers, Series):
        return movers
    box = np.asarray(query.option("box"), np.float64)
    if box.shape != (6,):
        return query.unknown("no box is declared")
    room = np.full(len(query.episode), np.inf)
    for mover in movers[0]:
        for axis, (low, high) in enumerate(zip(box[:3], box[3:], strict=True)):
            ahead = np.eye(3)[axis]
            room = np.minimum(room, high - reach(mover, ahead))
            room = np.minimum(room, -reach(mover, -ahead) - low)
    return complete(query, exact(room, query.dimension))
