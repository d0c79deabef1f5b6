"""Geoms as corners, edges and flat faces: what footprints, edges and hulls are cut from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Geom, Mesh

from .hull import hull_triangles
from .pose import transform

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

CHORD_ERROR = 5e-5
"""m. Edges along the rings of a round geom lie within this of the true surface, the triangles
between the rings within twice as much: footprints are right to 0.1 mm."""


@dataclass(frozen=True, eq=False)
class Polytope:
    """A convex polytope, or the surface of a mesh.

    Attributes:
        vertices: (V, 3) m, body frame.
        edges: (E, 2) vertex indices.
        faces: flat faces large enough to stand on, each (F,) vertex indices in order around it,
            counter-clockwise seen from outside. Round surfaces have none.
        convex: whether it is convex.
    """

    vertices: F64
    edges: I64
    faces: tuple[I64, ...]
    convex: bool = True


class Faces(NamedTuple):
    """All F flat faces of some polytopes, body frame.

    Attributes:
        normal: (F, 3) outward, unit length.
        anchor: (F, 3) m, a corner.
        corners: each face's (N, 3) corners, m, in order.
    """

    normal: F64
    anchor: F64
    corners: tuple[F64, ...]


def faces_of(parts: list[Polytope]) -> Faces:
    """The faces of all parts; those without area are left out."""
    corners = [part.vertices[face] for part in parts for face in part.faces]
    normal = np.array([np.cross(c[1] - c[0], c[2] - c[0]) for c in corners]).reshape(-1, 3)
    norm = np.sqrt((normal**2).sum(1))
    keep = np.flatnonzero(norm > 0)
    return Faces(
        normal[keep] / norm[keep, None],
        np.array([corners[i][0] for i in keep]).reshape(-1, 3),
        tuple(corners[i] for i in keep),
    )


class Pieces(NamedTuple):
    """The P convex pieces that some polytopes are made of, body frame.

    Attributes:
        vertices: (V, 3) m, piece after piece.
        first: (P + 1,) where each piece begins, and the last one ends.
    """

    vertices: F64
    first: I64


def pieces_of(parts: list[Polytope]) -> Pieces:
    """Convex parts as they are; the triangles of those that are not."""
    pieces = [
        corners
        for part in parts
        for corners in ([part.vertices] if part.convex else [part.vertices[f] for f in part.faces])
    ]
    first = np.cumsum([0, *map(len, pieces)])
    return Pieces(np.concatenate([np.empty((0, 3)), *pieces]), first.astype(np.int64))


def polytope(geom: Geom, meshes: Mapping[str, Mesh]) -> Polytope | None:
    """The geom in its body's frame; None for a plane, which has no corners."""
    if geom.kind == "plane":
        return None
    if geom.kind in ("mesh", "convex_mesh"):
        mesh = meshes[str(geom.mesh)]
        local = _hull(mesh.vertices) if geom.kind == "convex_mesh" else _surface(mesh)
    elif geom.kind == "box":
        local = _prism(np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * geom.size[:2], geom.size[2])
    elif geom.kind == "cylinder":
        local = _prism(_circle(geom.size[0]), geom.size[1])
    else:
        local = _round(geom)
    vertices = transform(geom.position, geom.orientation, local.vertices)
    return Polytope(vertices, local.edges, local.faces, local.convex)


def _circle(radius: float) -> F64:
    """(n, 2) m: a regular polygon inscribed in the circle, counter-clockwise, within CHORD_ERROR."""
    return np.asarray(radius * _ring(_around(radius)))


def hull_centroid(parts: list[Polytope]) -> F64:
    """(3,) m: centre of the volume of the convex hull of all parts; of a flat hull, its middle.

    Raises ValueError when there is no part.
    """
    if not parts:
        raise ValueError("a body without bounded geoms has no hull")
    points = np.concatenate([part.vertices for part in parts])
    inner = points.mean(0)
    hull = hull_triangles(points - inner)
    if hull is None:
        return np.asarray((points.min(0) + points.max(0)) / 2)
    corners = (points - inner)[hull.corners]
    volume = np.abs(np.linalg.det(corners))
    return np.asarray(inner + (corners.sum(1) / 4 * volume[:, None]).sum(0) / volume.sum())


def _around(radius: float) -> int:
    """Corners of an inscribed polygon within CHORD_ERROR of a circle; a multiple of 4, ≥ 16."""
    half_angle = np.arccos(max(1 - CHORD_ERROR / radius, 0.0))
    return int(max(16, 4 * np.ceil(np.pi / half_angle / 4)))


def _ring(n: int) -> F64:
    angles = 2 * np.pi * np.arange(n) / n
    return np.asarray(np.stack([np.cos(angles), np.sin(angles)], 1))


def _prism(outline: F64, half: float) -> Polytope:
    n = len(outline)
    bottom, top = np.arange(n), np.arange(n, 2 * n)
    vertices = np.concatenate([np.c_[outline, np.full(n, z)] for z in (-half, half)])
    edges = np.concatenate(
        [np.c_[bottom, np.roll(bottom, -1)], np.c_[top, np.roll(top, -1)], np.c_[bottom, top]]
    )
    faces = [bottom[::-1].copy(), top]
    if n == 4:  # a box: its sides are faces to stand on too
        faces += [np.array([i, (i + 1) % 4, n + (i + 1) % 4, n + i]) for i in range(4)]
    return Polytope(vertices, edges, tuple(faces))


def _round(geom: Geom) -> Polytope:
    """Sphere, ellipsoid or capsule: rings of latitude with a pole at either end."""
    if geom.kind == "capsule":
        radii, stretch = np.full(3, geom.size[0]), geom.size[1]
    else:
        radii, stretch = np.broadcast_to(np.array(geom.size, np.float64), (3,)), 0.0
    n = _around(float(radii.max()))
    latitude = np.pi * np.arange(1, n // 2) / (n // 2) - np.pi / 2
    heights = np.sin(latitude)
    shift = np.sign(np.round(heights, 12)) * stretch
    if stretch > 0:  # the equator is there twice, once at either end of the straight part
        middle = len(latitude) // 2
        latitude, heights = (np.insert(v, middle, 0.0) for v in (latitude, heights))
        shift = np.insert(shift, middle, -stretch)
        shift[middle + 1] = stretch
    ring = _ring(n)
    rows = len(latitude)
    body = np.empty((rows, n, 3))
    body[..., :2] = np.cos(latitude)[:, None, None] * ring * radii[:2]
    body[..., 2] = (heights * radii[2] + shift)[:, None]
    pole = np.array([0.0, 0.0, radii[2] + stretch])
    vertices = np.concatenate([body.reshape(-1, 3), [-pole, pole]])
    index = np.arange(rows * n).reshape(rows, n)
    edges = [
        np.stack([index, np.roll(index, -1, 1)], -1).reshape(-1, 2),
        np.stack([index[:-1], index[1:]], -1).reshape(-1, 2),
        np.c_[index[0], np.full(n, rows * n)],
        np.c_[index[-1], np.full(n, rows * n + 1)],
    ]
    return Polytope(vertices, np.concatenate(edges), ())


def _surface(mesh: Mesh) -> Polytope:
    faces = mesh.faces.astype(np.int64)
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), 1)
    return Polytope(
        mesh.vertices.astype(np.float64), np.unique(edges, axis=0), tuple(faces), convex=False
    )


def _hull(points: NDArray[np.float32]) -> Polytope:
    """The convex hull of points, coplanar triangles merged into faces; flat ones give one face."""
    vertices = points.astype(np.float64)
    hull = hull_triangles(vertices)
    if hull is None:
        every = np.arange(len(vertices))
        pairs = np.stack(np.triu_indices(len(vertices), 1), 1)
        return Polytope(vertices, pairs, (every,))
    edges = np.unique(np.sort(hull.corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), 1), axis=0)
    # triangles in one plane share it up to rounding
    _, group = np.unique(np.round(hull.planes, 6), axis=0, return_inverse=True)
    faces = []
    for g in range(group.max() + 1):
        members = group.ravel() == g
        corners = np.unique(hull.corners[members])
        faces.append(_ordered(vertices, corners, hull.planes[members][0, :3]))
    return Polytope(vertices, edges.astype(np.int64), tuple(faces))


def _ordered(vertices: F64, corners: NDArray[np.integer], normal: F64) -> I64:
    """Corners of a flat convex face, counter-clockwise about its outward normal (3,)."""
    points = vertices[corners] - vertices[corners].mean(0)
    first = points[0] / np.sqrt(points[0] @ points[0])
    angle = np.arctan2(points @ np.cross(normal, first), points @ first)
    return np.asarray(corners[np.argsort(angle)], np.int64)
