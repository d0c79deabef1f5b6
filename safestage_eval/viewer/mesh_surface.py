"""The part of a mesh that is drawn."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Mesh

DIRECTIONS = 240
"""Ways in which a convex mesh of many points is looked at for its outermost ones."""


def outer(mesh: Mesh) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Vertices (V, 3) m and outward triangles (F, 3) of a mesh's surface.

    A mesh with faces is taken as it is. A bare set of points becomes its convex hull; of more than
    ``DIRECTIONS`` points only those are kept that are outermost in one of so many directions
    (a Fibonacci lattice on the sphere), so that the drawn hull lies inside the true one, a little
    smaller. Points in a plane have no hull: no triangles.
    """
    if len(mesh.faces) or len(mesh.vertices) < 4:
        return mesh.vertices, mesh.faces
    from scipy.spatial import ConvexHull, QhullError

    points = mesh.vertices
    if len(points) > DIRECTIONS:
        middle = points - points.mean(0)
        points = points[np.unique((middle @ _lattice(DIRECTIONS).T).argmax(0))]
    try:
        hull = ConvexHull(points.astype(np.float64))
    except QhullError:
        return points, mesh.faces
    kept = np.sort(hull.vertices)
    row = np.zeros(len(points), np.int32)
    row[kept] = np.arange(len(kept))
    corners = points[hull.simplices].astype(np.float64)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normal, hull.equations[:, :3]) < 0
    faces = hull.simplices.copy()
    faces[inward] = faces[inward][:, ::-1]
    return points[kept], row[faces]


def _lattice(count: int) -> NDArray[np.float32]:
    """(count, 3) nearly even unit vectors (Gonzalez 2010, "Measurement of areas on a sphere")."""
    i = np.arange(count) + 0.5
    z = 1 - 2 * i / count
    turn = np.pi * (1 + 5**0.5) * i
    ring = np.sqrt(1 - z * z)
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), z], -1).astype(np.float32)
