"""Triangle meshes that need not be convex: distance between two of them, and what lies inside one."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .shape import Surface

F64 = NDArray[np.float64]

CHUNK = 1 << 20
"""Point × triangle pairs held in memory at once."""


class SurfacePair:
    """The distance of two meshes by python-fcl's hierarchy of boxes, exact to rounding when apart.

    Both meshes are given relative to their bodies' bounding centres, in body axes.
    """

    def __init__(self, a: Surface, b: Surface) -> None:
        import fcl

        self._fcl: Any = fcl
        self._a, self._b = (fcl.CollisionObject(_hierarchy(s)) for s in (a, b))

    def distance(self, pose_a: tuple[F64, F64], pose_b: tuple[F64, F64]) -> float:
        """Metres between the two surfaces; 0 where triangles intersect.

        A pose is (rotation (3, 3) body to world, bounding centre (3,) m, world).
        """
        for thing, pose in ((self._a, pose_a), (self._b, pose_b)):
            thing.setTransform(self._fcl.Transform(*pose))
        return max(float(self._fcl.distance(self._a, self._b)), 0.0)


def _hierarchy(surface: Surface) -> Any:
    import fcl

    model = fcl.BVHModel()
    model.beginModel(len(surface.faces), len(surface.vertices))
    model.addSubModel(surface.vertices, surface.faces.astype(np.int32))
    model.endModel()
    return model


def encloses(surface: Surface, points: F64) -> NDArray[np.bool_]:
    """(N,) whether points (N, 3) lie inside the mesh; in the mesh's own coordinates.

    By the winding number, the sum of the triangles' signed solid angles (van Oosterom & Strackee
    1983), above one half: a small hole in the mesh does not let the inside out.
    """
    inside = np.zeros(len(points), bool)
    low, high = surface.vertices.min(0), surface.vertices.max(0)
    near = np.flatnonzero(((points >= low) & (points <= high)).all(1))
    step = max(1, CHUNK // max(len(surface.faces), 1))
    corners = surface.vertices[surface.faces]
    for start in range(0, len(near), step):
        rows = near[start : start + step]
        a, b, c = (corners[None, :, i] - points[rows, None] for i in range(3))
        la, lb, lc = (np.sqrt((v * v).sum(-1)) for v in (a, b, c))
        volume = (a * np.cross(b, c)).sum(-1)
        ab, bc, ca = (a * b).sum(-1), (b * c).sum(-1), (c * a).sum(-1)
        solid = np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb)
        inside[rows] = np.abs(solid.sum(1)) > np.pi
    return inside
