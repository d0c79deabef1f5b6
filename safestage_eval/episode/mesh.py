"""Triangle meshes, stored once per content."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices and faces of a mesh or of a convex hull's point set.

    Attributes:
        vertices: (V, 3) m, geom frame.
        faces: (F, 3) vertex indices, outward by the right-hand rule; F = 0 for a bare point set.
    """

    vertices: NDArray[np.float32]
    faces: NDArray[np.int32]

    @classmethod
    def build(cls, vertices: ArrayLike, faces: ArrayLike = ()) -> Mesh:
        """Make a mesh from arrays; raises ValueError when a face names a vertex that does not exist."""
        v = np.ascontiguousarray(np.asarray(vertices, np.float32).reshape(-1, 3))
        f = np.ascontiguousarray(np.asarray(faces, np.int32).reshape(-1, 3))
        if f.size and (f.min() < 0 or f.max() >= len(v)):
            raise ValueError(f"faces index {f.min()}…{f.max()}, but there are {len(v)} vertices")
        return cls(v, f)

    @cached_property
    def key(self) -> str:
        """SHA-256 of the bytes: what ``Geom.mesh`` refers to."""
        digest = hashlib.sha256(np.array(self.vertices.shape + self.faces.shape, "<i8").tobytes())
        digest.update(self.vertices.astype("<f4").tobytes())
        digest.update(self.faces.astype("<i4").tobytes())
        return digest.hexdigest()
