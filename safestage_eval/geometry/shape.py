"""A body's collision geometry, packed into arrays for the kernels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Geom, Mesh

from .arrays import owned
from .hull import hull_triangles
from .polytope import Faces, Pieces, Polytope, faces_of, hull_centroid, pieces_of, polytope
from .pose import matrix

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

POINT, SEGMENT, BOX, CYLINDER, ELLIPSOID, HULL, PLANE = range(7)
"""Kernel codes. A sphere is a point with a margin, a capsule a segment along z with a margin.
Codes up to BOX are zonotopes: their penetration depth has a closed form."""

_CODES = {
    "sphere": POINT,
    "capsule": SEGMENT,
    "box": BOX,
    "cylinder": CYLINDER,
    "ellipsoid": ELLIPSOID,
    "plane": PLANE,
    "convex_mesh": HULL,
    "mesh": HULL,
}


class Packed(NamedTuple):
    """G convex geoms of one body, relative to the body's bounding centre, in body axes.

    Attributes:
        kind: (G,) one of the codes above.
        size: (G, 3) m. Half lengths of a box; (radius, radius, half length) of a cylinder;
            (0, 0, half length) of a segment; radii of an ellipsoid.
        margin: (G,) m, radius around a point or segment.
        rotation: (G, 3, 3) geom frame to body frame.
        offset: (G, 3) m, geom centre from the bounding centre.
        radius: (G,) m, of a ball around the geom centre that holds the geom, margin included.
        half: (G, 3) m, half lengths of a box in geom axes that holds the geom.
        first, points: (G,) where a hull starts, and how many rows it has, in ``vertices``.
        vertices: (V, 3) m, from the geom centre, in geom axes.
        ring: (V + 1,) where the neighbours of each vertex start in ``beside``.
        beside: (E,) rows of vertices: along edges of the hull from each vertex. Hulls of few
            vertices have none.
    """

    kind: I64
    size: F64
    margin: F64
    rotation: F64
    offset: F64
    radius: F64
    half: F64
    first: I64
    points: I64
    vertices: F64
    ring: I64
    beside: I64


@dataclass(frozen=True, eq=False)
class Surface:
    """A triangle mesh that need not be convex, relative to the body's bounding centre.

    Attributes:
        vertices: (V, 3) m, body axes.
        faces: (F, 3) vertex indices, outward by the right-hand rule.
    """

    vertices: F64
    faces: I64


@dataclass(frozen=True, eq=False)
class BodyShape:
    """All collision geometry of one body.

    Attributes:
        name: the body's name, for messages.
        centre: (3,) m, centre of the bounding box, in the body frame.
        half: (3,) m, half lengths of the box around all geoms, in body axes (inf with a plane).
        radius: m, of a ball around the centre that holds all geoms (inf with a plane).
        solids: the convex geoms.
        hulls: the same, and for each mesh the points of its vertices: what extents need.
        surfaces: the nonconvex meshes.
        geoms: the geoms as they are recorded, and ``meshes`` what they refer to.
    """

    name: str
    centre: F64
    half: F64
    radius: float
    solids: Packed
    hulls: Packed
    surfaces: tuple[Surface, ...]
    geoms: tuple[Geom, ...]
    meshes: Mapping[str, Mesh]

    @classmethod
    def build(cls, body: Body, meshes: Mapping[str, Mesh]) -> BodyShape:
        """Pack a body's geoms; ``meshes`` maps a geom's mesh key to the mesh (KeyError if absent).

        The same geoms give the same object again: a robot's links and a task's objects return in
        every episode, and a mesh key stands for the mesh's content.
        """
        shape = _SHAPES.get((body.name, body.geoms))
        if shape is None:
            if len(_SHAPES) >= SHAPES_KEPT:
                _SHAPES.clear()
            shape = _SHAPES[body.name, body.geoms] = cls._pack(body, meshes)
        return shape

    @classmethod
    def _pack(cls, body: Body, meshes: Mapping[str, Mesh]) -> BodyShape:
        parts = [_part(geom, meshes) for geom in body.geoms]
        low, high, reach = np.full(3, np.inf), np.full(3, -np.inf), 0.0
        for part in parts:
            spread = _spread(part)
            low = np.minimum(low, part.offset - spread)
            high = np.maximum(high, part.offset + spread)
        bounded = bool(parts) and bool(np.isfinite(low).all())
        centre = (low + high) / 2 if bounded else np.zeros(3)
        for part in parts:
            part.offset = part.offset - centre
            reach = max(reach, _reach(part))
        surfaces = tuple(
            Surface(
                owned(part.vertices @ part.rotation.T + part.offset),
                np.array(meshes[str(geom.mesh)].faces, np.int64),
            )
            for geom, part in zip(body.geoms, parts, strict=True)
            if geom.kind == "mesh"
        )
        hulls = _stack(parts)
        convex = [p for geom, p in zip(body.geoms, parts, strict=True) if geom.kind != "mesh"]
        solids = _stack(convex) if surfaces else hulls
        half = (high - low) / 2 if bounded else np.full(3, np.inf if parts else 0.0)
        used = {key: meshes[key] for geom in body.geoms if (key := geom.mesh) is not None}
        return cls(body.name, centre, half, reach, solids, hulls, surfaces, body.geoms, used)

    def __len__(self) -> int:
        """G, the number of geoms."""
        return len(self.geoms)

    @cached_property
    def polytopes(self) -> tuple[Polytope | None, ...]:
        """Corners, edges and faces of each geom in the body frame; None for a plane."""
        return tuple(polytope(geom, self.meshes) for geom in self.geoms)

    @cached_property
    def faces(self) -> Faces:
        """All flat faces, body frame; planes are left out."""
        return faces_of([part for part in self.polytopes if part is not None])

    @cached_property
    def pieces(self) -> Pieces:
        """Convex pieces, body frame; planes are left out."""
        return pieces_of([part for part in self.polytopes if part is not None])

    @cached_property
    def centroid(self) -> F64:
        """(3,) m, body frame: centre of the volume of the convex hull of all geoms but planes.

        Raises ValueError when there are none.
        """
        bounded = [geom for geom in self.geoms if geom.kind != "plane"]
        if len(bounded) == 1 and bounded[0].kind not in ("mesh", "convex_mesh"):
            return np.array(bounded[0].position)
        return hull_centroid([part for part in self.polytopes if part is not None])


SHAPES_KEPT = 4096
_SHAPES: dict[tuple[str, tuple[Geom, ...]], BodyShape] = {}


MANY_CORNERS = 128
"""Hulls of at least so many vertices are searched along their edges."""


class Graph(NamedTuple):
    """Which vertices of a hull share an edge.

    Attributes:
        degree: (V,) number of neighbours.
        beside: (E,) the neighbours of the first vertex, of the second, …
    """

    degree: I64
    beside: I64


@dataclass
class Part:
    """One geom on its way into ``Packed``; fields as there."""

    kind: int
    size: F64
    margin: float
    rotation: F64
    offset: F64
    radius: float
    half: F64
    vertices: F64
    graph: Graph | None = None


def _stack(parts: list[Part]) -> Packed:
    """Stack parts; an empty list gives G = 0."""
    count = np.array([len(part.vertices) for part in parts], np.int64)
    first = np.cumsum(count) - count
    degree, beside = [np.zeros(1, np.int64)], [np.zeros(0, np.int64)]
    for part, start in zip(parts, first, strict=True):
        graph = part.graph or Graph(np.zeros(len(part.vertices), np.int64), beside[0])
        degree.append(graph.degree)
        beside.append(graph.beside + start)
    return Packed(
        np.array([part.kind for part in parts], np.int64),
        owned([part.size for part in parts]).reshape(-1, 3),
        owned([part.margin for part in parts]),
        owned([part.rotation for part in parts]).reshape(-1, 3, 3),
        owned([part.offset for part in parts]).reshape(-1, 3),
        owned([part.radius for part in parts]),
        owned([part.half for part in parts]).reshape(-1, 3),
        first,
        count,
        owned(np.concatenate([part.vertices for part in parts] or [np.zeros((0, 3))])),
        np.cumsum(np.concatenate(degree)),
        np.concatenate(beside),
    )


def chosen(packed: Packed, rows: NDArray[np.bool_]) -> Packed:
    """Some of the geoms, by a mask (G,)."""
    shared = ("vertices", "ring", "beside")
    return packed._replace(
        **{name: field[rows] for name, field in packed._asdict().items() if name not in shared}
    )


def triangles(surface: Surface) -> Packed:
    """Every triangle of a mesh as a convex geom of three points, G = F."""
    corners = surface.vertices[surface.faces]
    middle = (corners.min(1) + corners.max(1)) / 2
    local = corners - middle[:, None]
    g = len(corners)
    return Packed(
        np.full(g, HULL, np.int64),
        np.zeros((g, 3)),
        np.zeros(g),
        np.tile(np.eye(3), (g, 1, 1)),
        owned(middle),
        np.sqrt((local**2).sum(-1)).max(1, initial=0.0),
        owned(np.abs(local).max(1, initial=0.0)),
        np.arange(0, 3 * g, 3, dtype=np.int64),
        np.full(g, 3, np.int64),
        owned(local.reshape(-1, 3)),
        np.zeros(3 * g + 1, np.int64),
        np.zeros(0, np.int64),
    )


def _part(geom: Geom, meshes: Mapping[str, Mesh]) -> Part:
    rotation, offset = matrix(geom.orientation), np.array(geom.position, np.float64)
    code, size, margin = _CODES[geom.kind], np.zeros(3), 0.0
    if code == ELLIPSOID and len(set(geom.size)) == 1:
        code = POINT
    vertices = np.zeros((0, 3))
    if code == HULL:
        mesh = meshes[str(geom.mesh)]
        points, graph = mesh.vertices, None
        if geom.kind == "convex_mesh":
            points, graph = convex_points(mesh), _GRAPHS.get(mesh.key)
        points = points.astype(np.float64)
        middle = (points.min(0) + points.max(0)) / 2
        vertices, offset = points - middle, offset + rotation @ middle
        half = np.abs(vertices).max(0)
        radius = float(np.sqrt((vertices**2).sum(1).max()))
        return Part(code, size, margin, rotation, offset, radius, half, vertices, graph)
    if code == PLANE:
        half, radius = np.full(3, np.inf), np.inf
    elif code == POINT:
        margin = radius = geom.size[0]
        half = np.full(3, margin)
    elif code == SEGMENT:
        margin, length = geom.size
        size, radius = np.array([0.0, 0.0, length]), length + margin
        half = np.array([margin, margin, length + margin])
    elif code == CYLINDER:
        size = half = np.array([geom.size[0], geom.size[0], geom.size[1]])
        radius = float(np.hypot(geom.size[0], geom.size[1]))
    else:
        size = half = np.array(geom.size)
        radius = float(np.sqrt(half @ half) if code == BOX else half.max())
    return Part(code, size, margin, rotation, offset, radius, half, vertices)


_GRAPHS: dict[str, Graph] = {}
_HULL_POINTS: dict[str, NDArray[np.float32]] = {}


def convex_points(mesh: Mesh) -> NDArray[np.float32]:
    """(V, 3) the vertices of a convex mesh that span its hull; all of them where it is flat.

    Remembered by the mesh's content: a robot's links are the same in every episode.
    """
    if len(mesh.vertices) <= 32:
        return mesh.vertices
    if mesh.key not in _HULL_POINTS:
        hull = hull_triangles(mesh.vertices.astype(np.float64))
        corners = np.arange(len(mesh.vertices)) if hull is None else np.unique(hull.corners)
        _HULL_POINTS[mesh.key] = mesh.vertices[corners]
        if hull is not None and len(corners) >= MANY_CORNERS:
            _GRAPHS[mesh.key] = _graph(corners, hull.corners)
    return _HULL_POINTS[mesh.key]


def _graph(corners: NDArray[np.integer], faces: NDArray[np.integer]) -> Graph:
    """The edges of a triangulated hull; faces (F, 3) refer to the points that corners (V,) list."""
    row = np.zeros(int(corners.max()) + 1, np.int64)
    row[corners] = np.arange(len(corners))
    ends = row[faces[:, [[0, 1], [1, 2], [2, 0], [1, 0], [2, 1], [0, 2]]].reshape(-1, 2)]
    count = len(corners)
    first, second = np.divmod(np.unique(ends[:, 0] * count + ends[:, 1]), count)
    return Graph(np.bincount(first, minlength=count), second)


def _spread(part: Part) -> F64:
    """(3,) half lengths, in body axes, of the box around a geom."""
    if part.kind == PLANE:
        return np.full(3, np.inf)
    return np.asarray(np.abs(part.rotation) @ part.half)


_SIGNS = np.array(list(product((-1.0, 1.0), repeat=3))).T


def _reach(part: Part) -> float:
    """Distance from the bounding centre within which the whole geom lies."""
    if part.kind == PLANE:
        return np.inf
    corners = part.rotation @ (_SIGNS * part.half[:, None]) + part.offset[:, None]
    return float(
        min(np.sqrt(part.offset @ part.offset) + part.radius, np.sqrt((corners**2).sum(0).max()))
    )
