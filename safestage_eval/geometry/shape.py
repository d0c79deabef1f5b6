"""A body's collision geometry, prepared for measuring."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Geom, Mesh

from .corners import Corners
from .polytope import Faces, Pieces, Polytope, faces_of, hull_centroid, pieces_of, polytope
from .pose import matrix

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

POINT, SEGMENT, BOX, CYLINDER, ELLIPSOID, HULL, PLANE = range(7)
"""A sphere is a point with a margin, a capsule a segment along z with a margin. Codes up to BOX are
zonotopes: their penetration depth has a closed form."""

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


class Solids(NamedTuple):
    """G convex geoms, relative to their bodies' bounding centres, in body axes.

    Attributes:
        kind: (G,) one of the codes above; a nonconvex mesh counts as its hull.
        size: (G, 3) m. Half lengths of a box; (radius, radius, half length) of a cylinder;
            (0, 0, half length) of a segment; radii of an ellipsoid.
        margin: (G,) m, radius around a point or segment.
        rotation: (G, 3, 3) geom frame to body frame.
        offset: (G, 3) m, geom centre from the bounding centre.
        radius: (G,) m, of a ball around the geom centre that holds the geom, margin included.
        half: (G, 3) m, half lengths of a box in geom axes that holds the geom.
        corners: of each geom those of a hull, from the geom centre, in geom axes.
    """

    kind: I64
    size: F64
    margin: F64
    rotation: F64
    offset: F64
    radius: F64
    half: F64
    corners: tuple[Corners, ...]


def stacked(solids: Sequence[Solids]) -> Solids:
    """The geoms of several bodies, one after the other."""
    columns = list(zip(*solids, strict=True))
    arrays = [np.concatenate(column) for column in columns[:-1]]
    return Solids._make([*arrays, tuple(v for column in columns[-1] for v in column)])


class Surface(NamedTuple):
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
        solids: the geoms; for a nonconvex mesh, its hull.
        surfaces: the nonconvex meshes.
        geoms: the geoms as they are recorded, and ``meshes`` what they refer to.
    """

    name: str
    centre: F64
    half: F64
    radius: float
    solids: Solids
    surfaces: tuple[Surface, ...]
    geoms: tuple[Geom, ...]
    meshes: Mapping[str, Mesh]

    @classmethod
    def build(cls, body: Body, meshes: Mapping[str, Mesh]) -> BodyShape:
        """Prepare a body's geoms; ``meshes`` maps a geom's mesh key to the mesh (KeyError if absent).

        The same geoms give the same object again: a robot's links and a task's objects return in
        every episode, and a mesh key stands for the mesh's content.
        """
        shape = _SHAPES.get((body.name, body.geoms))
        if shape is None:
            if len(_SHAPES) >= SHAPES_KEPT:
                _SHAPES.clear()
            shape = _SHAPES[body.name, body.geoms] = cls._prepare(body, meshes)
        return shape

    @classmethod
    def _prepare(cls, body: Body, meshes: Mapping[str, Mesh]) -> BodyShape:
        solids = stacked([_NONE, *(_solid(geom, meshes) for geom in body.geoms)])
        centre, half, radius = np.zeros(3), np.full(3, np.inf), np.inf
        if (solids.kind != PLANE).all():
            spread = (np.abs(solids.rotation) * solids.half[:, None]).sum(-1)
            low = (solids.offset - spread).min(0, initial=np.inf)
            high = (solids.offset + spread).max(0, initial=-np.inf)
            half, radius = np.zeros(3), 0.0
            if body.geoms:
                centre, half = (low + high) / 2, (high - low) / 2
                solids = solids._replace(offset=solids.offset - centre)
                radius = _reach(solids)
        surfaces = tuple(
            Surface(
                solids.corners[g].points @ solids.rotation[g].T + solids.offset[g],
                np.array(meshes[str(geom.mesh)].faces, np.int64),
            )
            for g, geom in enumerate(body.geoms)
            if geom.kind == "mesh"
        )
        used = {key: meshes[key] for geom in body.geoms if (key := geom.mesh) is not None}
        return cls(body.name, centre, half, radius, solids, surfaces, body.geoms, used)

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

_NONE = Solids(
    np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3, 3)), np.zeros((0, 3)),
    np.zeros(0), np.zeros((0, 3)), (),
)  # fmt: skip
_SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))


def _solid(geom: Geom, meshes: Mapping[str, Mesh]) -> Solids:
    """One geom, from the body's origin."""
    rotation, offset = matrix(geom.orientation), np.array(geom.position, np.float64)
    code, size, margin, vertices = _CODES[geom.kind], np.zeros(3), 0.0, np.zeros((0, 3))
    if code == ELLIPSOID and len(set(geom.size)) == 1:
        code = POINT
    if code == HULL:
        mesh = meshes[str(geom.mesh)]
        points = mesh.vertices.astype(np.float64)
        middle = (points.min(0) + points.max(0)) / 2
        vertices, offset = points - middle, offset + rotation @ middle
        half = np.abs(vertices).max(0)
        radius = float(np.sqrt((vertices**2).sum(1).max()))
    elif code == PLANE:
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
    return Solids(
        np.array([code]), size[None], np.array([margin]), rotation[None], offset[None],
        np.array([radius]), half[None], (Corners(vertices),),
    )  # fmt: skip


def _reach(solids: Solids) -> float:
    """m, distance from the bounding centre within which all bounded geoms lie."""
    corners = _SIGNS * solids.half[:, None]
    corners = corners @ solids.rotation.swapaxes(1, 2) + solids.offset[:, None]
    ball = np.sqrt((solids.offset**2).sum(1)) + solids.radius
    return float(np.minimum(ball, np.sqrt((corners**2).sum(-1)).max(1)).max())
