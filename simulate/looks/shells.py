"""Meshes with texture coordinates: surfaces of revolution, boxes with rounded edges, bent tubes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
AROUND = 40
"""Corners of a circle."""
CAP = 0.1
"""Share of a texture's height that either end of a surface of revolution has."""
SIDES = ((0, 1), (1, 1), (2, 1), (0, -1), (1, -1), (2, -1))
"""Axis and sign of a box's sides, as the cells of its texture: +x +y +z below, −x −y −z above."""


@dataclass(frozen=True)
class Shell:
    """A surface of triangles.

    Attributes:
        vertices: (V, 3) m.
        normals: (V, 3) unit vectors outwards.
        uv: (V, 2) place in the texture, 0 … 1 from its left and bottom.
        faces: (F, 3) vertices, anticlockwise from outside.
    """

    vertices: F64
    normals: F64
    uv: F64
    faces: NDArray[np.int64]

    def moved(self, position: Sequence[float], orientation: Sequence[float]) -> Shell:
        """This shell moved elsewhere; orientation wxyz, applied first."""
        w, x, y, z = orientation
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        return replace(
            self, vertices=self.vertices @ turn.T + position, normals=self.normals @ turn.T
        )


def revolved(profile: Sequence[tuple[float, float]], sharp: float = 40.0) -> Shell:
    """A profile of (radius, z) in m turned about z, from its lower end outwards round to the upper.

    In the texture x goes around and y along the profile: an end that is a flat disc takes a share
    ``CAP``, the rest goes by length. Edges of more than ``sharp`` degrees are seen as edges.
    """
    points = np.array(profile, float)
    step = np.diff(points, axis=0)
    length = np.hypot(step[:, 0], step[:, 1])
    keep = length > 1e-9
    points = np.concatenate([points[:1], points[1:][keep]])
    step, length = step[keep], length[keep]
    flat = np.abs(step[:, 1]) < 1e-9
    weight = length.copy()
    first, last = bool(flat[0]), bool(flat[-1])
    inner = slice(int(first), len(weight) - int(last))
    room = 1 - CAP * (first + last)
    weight[inner] *= room / max(float(weight[inner].sum()), 1e-12)
    if first:
        weight[0] = CAP
    if last:
        weight[-1] = CAP
    v = np.concatenate([[0.0], np.cumsum(weight)])
    out = np.stack([step[:, 1], -step[:, 0]], axis=1) / length[:, None]
    rows: list[tuple[F64, F64, float]] = []
    strips: list[tuple[int, int]] = []
    limit = np.cos(np.radians(sharp))
    for i in range(len(step)):
        before = out[i] + out[i - 1] if i and out[i] @ out[i - 1] > limit else out[i]
        next_to = i + 1 < len(step) and out[i] @ out[i + 1] > limit
        after = out[i] + out[i + 1] if next_to else out[i]
        strips.append((len(rows), len(rows) + 1))
        rows += [(points[i], before, float(v[i])), (points[i + 1], after, float(v[i + 1]))]
    angle = np.linspace(0, 2 * np.pi, AROUND + 1)
    cos, sin = np.cos(angle), np.sin(angle)
    vertices, normals, uv = [], [], []
    for (radius, z), normal, height in rows:
        radial, rise = normal / np.linalg.norm(normal)
        vertices.append(np.stack([radius * cos, radius * sin, np.full_like(cos, z)], 1))
        normals.append(np.stack([radial * cos, radial * sin, np.full_like(cos, rise)], 1))
        uv.append(np.stack([angle / (2 * np.pi), np.full_like(cos, height)], 1))
    faces = []
    around = np.arange(AROUND)
    wide = AROUND + 1
    for low, high in strips:
        a, b = low * wide + around, low * wide + around + 1
        c, d = high * wide + around, high * wide + around + 1
        if rows[low][0][0] > 1e-9:
            faces.append(np.stack([a, b, d], 1))
        if rows[high][0][0] > 1e-9:
            faces.append(np.stack([a, d, c], 1))
    return Shell(
        np.concatenate(vertices), np.concatenate(normals), np.concatenate(uv), np.concatenate(faces)
    )


def ellipsoid(radii: Sequence[float]) -> Shell:
    """Half axes in m; the texture's y goes from the lower pole to the upper."""
    angles = np.linspace(-np.pi / 2, np.pi / 2, 25)
    ball = revolved([(float(np.cos(a)), float(np.sin(a))) for a in angles])
    normals = ball.vertices / np.asarray(radii)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return replace(ball, vertices=ball.vertices * radii, normals=normals)


def capsule(radius: float, half: float) -> Shell:
    """Along z, ``half`` m of its straight part on either side of the middle."""
    low, high = np.linspace(-np.pi / 2, 0, 10), np.linspace(0, np.pi / 2, 10)
    return revolved(
        [(float(radius * np.cos(a)), float(radius * np.sin(a) - half)) for a in low]
        + [(float(radius * np.cos(a)), float(radius * np.sin(a) + half)) for a in high]
    )


def rounded_box(half: Sequence[float], bevel: float) -> Shell:
    """A box whose edges are bevelled by so many m, and shaded as if round.

    Its texture has two rows of three cells, a cell per side: see ``SIDES``.
    """
    h = np.asarray(half, float)
    b = min(bevel, 0.45 * float(h.min()))
    vertices: list[F64] = []
    normals: list[F64] = []
    uv: list[tuple[float, float]] = []
    faces: list[tuple[int, int, int]] = []

    def corner(signs: F64, side: int) -> F64:
        """Where the corner of those signs lies on a side's flat part."""
        at = signs * (h - b)
        axis = SIDES[side][0]
        at[axis] = signs[axis] * h[axis]
        return at

    def add(signs: F64, side: int, cell: int) -> int:
        axis, sign = SIDES[side]
        normal = np.zeros(3)
        normal[axis] = sign
        vertices.append(corner(signs, side))
        normals.append(normal)
        across, up = _in_cell(cell, signs)
        uv.append(((cell % 3 + across) / 3, (cell // 3 + up) / 2))
        return len(vertices) - 1

    def face(of: Sequence[int]) -> None:
        """Triangles of a convex polygon, turned so that they face outwards."""
        a, m, c = (vertices[i] for i in of[:3])
        middle = np.sum([normals[i] for i in of], axis=0)
        ring = list(of) if np.cross(m - a, c - a) @ middle > 0 else list(of)[::-1]
        faces.extend((ring[0], ring[i], ring[i + 1]) for i in range(1, len(ring) - 1))

    for side, (axis, sign) in enumerate(SIDES):
        quad = []
        for p, q in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
            signs = np.insert(np.array([p, q], float), axis, sign)
            quad.append(add(signs, side, side))
        face(quad)
    for one, other in product(range(6), range(6)):
        (a, s), (c, t) = SIDES[one], SIDES[other]
        if a >= c:
            continue
        free = 3 - a - c
        strip = []
        for along, side in ((-1, one), (1, one), (1, other), (-1, other)):
            signs = np.zeros(3)
            signs[a], signs[c], signs[free] = s, t, along
            strip.append(add(signs, side, one))
        face(strip)
    for octant in product((-1.0, 1.0), repeat=3):
        sides = [SIDES.index((axis, int(octant[axis]))) for axis in range(3)]
        face([add(np.array(octant), side, sides[2]) for side in sides])
    return Shell(np.array(vertices), np.array(normals), np.array(uv), np.array(faces))


def _in_cell(cell: int, signs: F64) -> tuple[float, float]:
    """Place in a side's cell of a corner: x to the right as seen from outside, up is z, or y on ±z."""
    axis, sign = SIDES[cell]
    x, y, z = (signs + 1) / 2
    edge = 0.02
    across, up = (
        (y if sign > 0 else 1 - y, z) if axis == 0
        else (1 - x if sign > 0 else x, z) if axis == 1
        else (x if sign > 0 else 1 - x, y)
    )  # fmt: skip
    return edge + (1 - 2 * edge) * float(across), edge + (1 - 2 * edge) * float(up)


def tube(path: F64, radius: float) -> Shell:
    """A tube along (N, 3) m in a plane of constant y; its ends are open."""
    ways = np.gradient(path, axis=0)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    side = np.array([0.0, 1.0, 0.0])
    angle = np.linspace(0, 2 * np.pi, 13)
    normals = np.concatenate(
        [
            np.outer(np.cos(angle), side) + np.outer(np.sin(angle), np.cross(way, side))
            for way in ways
        ]
    )
    vertices = np.repeat(path, 13, 0) + radius * normals
    share = np.linspace(0, 1, len(path))
    uv = np.stack([np.tile(angle / (2 * np.pi), len(path)), np.repeat(share, 13)], 1)
    faces = []
    for i, j in product(range(len(path) - 1), range(12)):
        a, b = 13 * i + j, 13 * i + j + 1
        for p, q, r in ((a, b, b + 13), (a, b + 13, a + 13)):
            flat = np.cross(vertices[q] - vertices[p], vertices[r] - vertices[p])
            faces.append((p, q, r) if flat @ normals[p] > 0 else (p, r, q))
    return Shell(vertices, normals, uv, np.array(faces))
