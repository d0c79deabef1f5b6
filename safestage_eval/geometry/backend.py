"""Distances by python-fcl or coal in place of our own, for comparison.

They answer for every frame and every pair of geoms whose bounding balls are nearer than the cap;
what is left out is proven by those balls alone. Nothing else of ours is in the answer, so what
differs is theirs. They give one number and no bounds: docs/clearance.md tells what each gets wrong.
Half-spaces crash python-fcl: it is not asked about them, and their closed form is used instead.
"""

from __future__ import annotations

from collections.abc import Iterable
from importlib.util import find_spec
from typing import Any, Literal, Protocol, get_args

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError

from .hull import hull_triangles
from .mover import Mover
from .pose import matrix
from .shape import BodyShape

F64 = NDArray[np.float64]

Backend = Literal["gjk", "fcl", "coal"]
BACKENDS: tuple[Backend, ...] = get_args(Backend)

NO_DEPTH = -1e3
"""m. coal answers −1.8e308 where its depth search failed: penetrating, nobody knows how deep."""


class Library(Protocol):
    """Distances of another library."""

    def solid(self, shape: BodyShape, index: int) -> Any:
        """Geom number ``index`` of a body, about its own centre; None if it cannot be used."""

    def distance(self, a: Any, pose_a: tuple[F64, F64], b: Any, pose_b: tuple[F64, F64]) -> float:
        """m, as the library tells it; a pose is (rotation (3, 3), centre (3,) m, world)."""


def library(backend: str) -> Library:
    """Load the library behind a name other than ``gjk``. Raises InputError when it cannot be used."""
    check_backend(backend)
    return _Fcl() if backend == "fcl" else _Coal()


def check_backend(backend: str) -> None:
    """Raises InputError for a name that does not exist, or whose library is not installed."""
    if backend not in BACKENDS:
        raise InputError(
            "clearance backend", f"there is no {backend!r}.", ", ".join(BACKENDS)
        )  # fmt: skip
    if backend == "coal" and find_spec("coal") is None:
        raise InputError(
            "clearance backend coal", "the library coal is not installed.",
            fix="pip install 'safestage[coal]', or choose gjk, which needs nothing",
        )  # fmt: skip


def foreign_pairs(
    pairs: Iterable[tuple[Mover, Mover]], frames: int, cap: float, backend: str
) -> tuple[F64, F64]:
    """(T,) lower and (T,) upper bound, m, of the least distance over pairs, as a library tells it.

    Both are its number, or −inf and 0 where it only says that there is a penetration. Beyond
    ``cap`` (m): cap and +inf.
    """
    lower, upper = np.full(frames, float(cap)), np.full(frames, np.inf)
    foreign = library(backend)
    solids: dict[tuple[int, bool], list[Any]] = {}
    for a, b in pairs:
        if a is b or not len(a.shape) or not len(b.shape):
            continue
        sides = []
        for shape, second in ((a.shape, False), (b.shape, True)):  # a solid has one pose at a time
            key = id(shape), second
            if key not in solids:
                solids[key] = [foreign.solid(shape, i) for i in range(len(shape))]
            sides.append(solids[key])
        ours, theirs = _geoms(a, frames), _geoms(b, frames)
        for i, one in enumerate(sides[0]):
            for j, other in enumerate(sides[1]):
                if one is None or other is None:
                    continue
                (Ra, pa), (Rb, pb) = ours[i], theirs[j]
                radii = a.shape.hulls.radius[i] + b.shape.hulls.radius[j]
                apart = np.sqrt(((pa - pb) ** 2).sum(1)) - radii
                for t in np.flatnonzero(apart < cap):
                    value = foreign.distance(one, (Ra[t], pa[t]), other, (Rb[t], pb[t]))
                    if value <= NO_DEPTH:
                        lower[t], upper[t] = -np.inf, min(upper[t], 0.0)
                    elif value < cap:
                        lower[t], upper[t] = min(lower[t], value), min(upper[t], value)
    return lower, upper


def _geoms(mover: Mover, frames: int) -> list[tuple[F64, F64]]:
    """Per geom (T, 3, 3) rotations and (T, 3) centres, m, world."""
    body, hulls = matrix(mover.orientation), mover.shape.hulls
    poses = []
    for i in range(len(mover.shape)):
        turned = np.ascontiguousarray(body @ hulls.rotation[i])
        centre = body @ hulls.offset[i] + mover.motion.centre
        poses.append(
            (np.broadcast_to(turned, (frames, 3, 3)), np.broadcast_to(centre, (frames, 3)))
        )
    return poses


def _triangles(shape: BodyShape, index: int) -> tuple[F64, NDArray[np.int64]]:
    """(V, 3) m vertices and (F, 3) outward faces of a mesh or of a convex mesh's hull."""
    hulls, geom = shape.hulls, shape.geoms[index]
    first = hulls.first[index]
    vertices = hulls.vertices[first : first + hulls.points[index]]
    if geom.kind == "mesh":
        return vertices, np.asarray(shape.meshes[str(geom.mesh)].faces, np.int64)
    hull = hull_triangles(vertices)
    if hull is None:
        raise ValueError("a flat convex mesh has no triangles to give to FCL")
    return vertices, hull.corners


class _Fcl:
    """python-fcl: its default solver, distances without sign."""

    def __init__(self) -> None:
        import fcl

        self._fcl: Any = fcl

    def solid(self, shape: BodyShape, index: int) -> Any:
        fcl, size = self._fcl, shape.geoms[index].size
        match shape.geoms[index].kind:
            case "plane":
                return None
            case "sphere":
                solid = fcl.Sphere(size[0])
            case "capsule":
                solid = fcl.Capsule(size[0], 2 * size[1])
            case "cylinder":
                solid = fcl.Cylinder(size[0], 2 * size[1])
            case "box":
                solid = fcl.Box(*(2 * s for s in size))
            case "ellipsoid":
                solid = fcl.Ellipsoid(*size)
            case "convex_mesh":
                vertices, faces = _triangles(shape, index)
                flat = np.c_[np.full(len(faces), 3), faces].ravel()
                solid = fcl.Convex(vertices, len(faces), flat)
            case _:
                vertices, faces = _triangles(shape, index)
                solid = fcl.BVHModel()
                solid.beginModel(len(faces), len(vertices))
                solid.addSubModel(vertices, faces.astype(np.int32))
                solid.endModel()
        return fcl.CollisionObject(solid)

    def distance(self, a: Any, pose_a: tuple[F64, F64], b: Any, pose_b: tuple[F64, F64]) -> float:
        a.setTransform(self._fcl.Transform(*pose_a))
        b.setTransform(self._fcl.Transform(*pose_b))
        value = float(self._fcl.distance(a, b))
        return value if value >= 0 else -np.inf  # −1: penetrating


class _Coal:
    """coal: signed distances, its own tolerances of 1e-6; tighter ones make its depths fail."""

    def __init__(self) -> None:
        import coal

        self._coal: Any = coal
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        self._request.gjk_tolerance = self._request.epa_tolerance = 1e-6

    def solid(self, shape: BodyShape, index: int) -> Any:
        coal, size = self._coal, shape.geoms[index].size
        match shape.geoms[index].kind:
            case "plane":
                return coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)
            case "sphere":
                return coal.Sphere(size[0])
            case "capsule":
                return coal.Capsule(size[0], 2 * size[1])
            case "cylinder":
                return coal.Cylinder(size[0], 2 * size[1])
            case "box":
                return coal.Box(*(2 * s for s in size))
            case "ellipsoid":
                return coal.Ellipsoid(*size)
        vertices, faces = _triangles(shape, index)
        if shape.geoms[index].kind == "convex_mesh":
            points = coal.StdVec_Vec3s()
            for vertex in vertices:
                points.append(vertex)
            return coal.Convex.convexHull(points, False, "")
        model = coal.BVHModelOBBRSS()
        model.beginModel(len(faces), len(vertices))
        for face in faces:
            model.addTriangle(*(vertices[k] for k in face))
        model.endModel()
        return model

    def distance(self, a: Any, pose_a: tuple[F64, F64], b: Any, pose_b: tuple[F64, F64]) -> float:
        self._result.clear()
        place_a, place_b = (self._coal.Transform3s(*pose) for pose in (pose_a, pose_b))
        return float(self._coal.distance(a, place_a, b, place_b, self._request, self._result))
