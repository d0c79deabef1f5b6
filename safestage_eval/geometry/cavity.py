"""The room inside a container: how deep a body is in it, judged in the container's own frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Cavity

from .extent import farthest_point
from .mover import Mover, frame_count
from .pose import compose, inverse_transform, rotate, transform

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

CONTACT_TOLERANCE = 2e-3
"""m. Bodies in contact overlap a little; what lies on the floor or leans on a wall may be this
far outside the cavity, and what lies across the rim may hang this far into it."""


def containment_depth(a: Mover, container: Mover, cavity: Cavity) -> F64:
    """(T,) m: signed depth of a's hull centroid in the container's cavity.

    Positive inside: the distance to the nearest of floor, side walls and rim plane. Negative
    outside: minus the distance to the cavity. Raises ValueError when a has no bounded geoms.
    """
    return _cavity_depth(_centroid_in_cavity(a, container, cavity), cavity)


def _cavity_depth(point: F64, cavity: Cavity) -> F64:
    """(T,) m: signed depth of points (T, 3), given in the cavity's frame; as containment_depth."""
    side, axial = _beyond(point, cavity)
    beyond = np.concatenate([side, axial[:, None]], 1)
    outside = np.sqrt((np.maximum(beyond, 0) ** 2).sum(1))
    return np.asarray(-np.where(outside > 0, outside, beyond.max(1)))


def inside_parts(a: Mover, container: Mover, cavity: Cavity) -> tuple[Bool, Bool]:
    """The two geometric halves of "a is inside the container", (T,) each.

    Returns:
        low_point_in: a's lowest point along the cavity's axis is below the rim, above the floor
            and between the walls (to within CONTACT_TOLERANCE).
        centroid_in: a's hull centroid is in the cavity.
    """
    frames = frame_count(a, container)
    position, orientation = _cavity_pose(container, cavity)
    axis = rotate(orientation, (0.0, 0.0, 1.0))
    low = inverse_transform(position, orientation, farthest_point(a, -axis))
    side, _ = _beyond(low, cavity)
    depth = cavity.size[-1]
    low_in = (
        (side <= CONTACT_TOLERANCE).all(1)
        & (low[:, 2] < depth - CONTACT_TOLERANCE)
        & (low[:, 2] > -depth - CONTACT_TOLERANCE)
    )
    centroid_in = _cavity_depth(_centroid_in_cavity(a, container, cavity), cavity) > 0
    return np.broadcast_to(low_in, frames), np.broadcast_to(centroid_in, frames)


def _cavity_pose(container: Mover, cavity: Cavity) -> tuple[F64, F64]:
    return compose(container.position, container.orientation, cavity.position, cavity.orientation)


def _centroid_in_cavity(a: Mover, container: Mover, cavity: Cavity) -> F64:
    centroid = transform(a.position, a.orientation, a.shape.centroid)
    return inverse_transform(*_cavity_pose(container, cavity), centroid)


def _beyond(point: F64, cavity: Cavity) -> tuple[F64, F64]:
    """How far points (T, 3) in the cavity's frame lie beyond its walls (T, 1 or 2) and ends (T,)."""
    axial = np.abs(point[:, 2]) - cavity.size[-1]
    if cavity.kind == "box":
        return np.abs(point[:, :2]) - np.array(cavity.size[:2]), axial
    return np.hypot(point[:, :1], point[:, 1:2]) - cavity.size[0], axial
