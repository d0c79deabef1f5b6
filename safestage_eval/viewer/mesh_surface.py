"""The part of a mesh that is drawn."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Mesh
from safestage_eval.geometry.hull import hull_triangles

DIRECTIONS = 240
"""Ways in which a convex mesh of many points is looked at for its outermost ones."""


def outer(mesh: Mesh) -> tuple[NDArray[np.float32], NDArray[np.integer[Any]]]:
    """Vertices (V, 3) m and outward triangles (F, 3) of a mesh's surface.

    A mesh with faces is taken as it is. A bare set of points becomes its convex hull; of more than
    ``DIRECTIONS`` points only the outermost ones are kept, so that the drawn hull lies inside the
    true one, a little smaller. Points in a plane have no hull: no triangles.
    """
    if len(mesh.faces) or len(mesh.vertices) < 4:
        return mesh.vertices, mesh.faces
    points = mesh.vertices
    if len(points) > DIRECTIONS:
        points = points[outermost(points - points.mean(0), DIRECTIONS)]
    hull = hull_triangles(points.astype(np.float64))
    if hull is None:
        return points, mesh.faces
    kept, rows = np.unique(hull.corners, return_inverse=True)
    return points[kept], rows.reshape(-1, 3)


def outermost(points: NDArray[Any], count: int) -> NDArray[np.intp]:
    """Rows of points (N, 3) that are farthest in one of ``count`` nearly even directions."""
    return np.unique((points @ _lattice(count).astype(points.dtype).T).argmax(0))


@cache
def _lattice(count: int) -> NDArray[np.float64]:
    """(count, 3) nearly even unit vectors (Gonzalez 2010, "Measurement of areas on a sphere")."""
    i = np.arange(count) + 0.5
    z = 1 - 2 * i / count
    turn = np.pi * (1 + 5**0.5) * i
    ring = np.sqrt(1 - z * z)
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), z], -1)
