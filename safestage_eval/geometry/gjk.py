"""Certified distances of many pairs of convex geoms at once.

Gilbert, Johnson & Keerthi 1988, "A fast procedure for computing the distance between complex
objects in three-dimensional space": the distance of A and B is the distance of the origin from
their Minkowski difference A − B. Every step yields a point v of A − B, so the distance is at most
|v|, and a support point w in direction −v, so the distance is at least v·w/|v|. Both are returned;
a search ends when they are TOLERANCE apart, whatever it did to get there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .penetration import penetration_depths
from .shape import BOX, PLANE, Solids
from .support import support_points, support_values

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Bool = NDArray[np.bool_]

TOLERANCE = 1e-10
"""m, between the bounds at which a search ends."""

PROMISED = 1e-9
"""m, the widest interval of two convex geoms that are apart."""

TOUCHING = 1e-13
"""m, core distance below which cores count as meeting: far above float64 rounding at 10 m."""

ITERATIONS = 128

_EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])
_FACES = np.array([[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]])
_FACE_SIGNS = np.array([1.0, -1.0, 1.0, -1.0])


@dataclass(frozen=True, eq=False)
class Pairs:
    """N pairs of convex geoms as they lie to each other.

    Attributes:
        solids: all geoms.
        a, b: (N,) which two of them each pair is.
        turn_a, turn_b: (N, 3, 3) from their axes to the world's.
        gap: (N, 3) m, from the centre of a to that of b, world.
        flat: whether their projections onto the horizontal plane are meant.
    """

    solids: Solids
    a: I64
    b: I64
    turn_a: F64
    turn_b: F64
    gap: F64
    flat: bool

    def __len__(self) -> int:
        """N."""
        return len(self.a)

    def at(self, rows: NDArray[np.integer] | Bool) -> Pairs:
        """Some of them."""
        return Pairs(
            self.solids, self.a[rows], self.b[rows], self.turn_a[rows], self.turn_b[rows],
            self.gap[rows], self.flat,
        )  # fmt: skip

    def farthest(self, direction: F64) -> F64:
        """(N, 3) the points of the cores' differences A − B that are farthest along directions (N, 3)."""
        first = support_points(self.solids, self.a, _turned_back(self.turn_a, direction))
        second = support_points(self.solids, self.b, -_turned_back(self.turn_b, direction))
        out = _turned(self.turn_a, first) - _turned(self.turn_b, second) - self.gap
        if self.flat:
            out[:, 2] = 0.0
        return out


def distances(pairs: Pairs, stop: F64, deep: float | None) -> tuple[F64, F64]:
    """Bounds (N,) m on signed distances, margins included; planes too.

    They are at most PROMISED apart unless cores meet or the distance is above ``stop`` (N,). Where
    cores meet, the signed distance is minus the penetration depth, the length of the shortest move
    that parts the two: known to PROMISED for boxes, capsules and spheres; for all others to
    ``deep`` (m), and without only to be at most minus the sum of the margins and at
    least minus the smallest overlap found.
    """
    kind, margins = pairs.solids.kind, pairs.solids.margin[pairs.a] + pairs.solids.margin[pairs.b]
    lower, upper = np.empty(len(pairs)), np.empty(len(pairs))
    endless = (kind[pairs.a] == PLANE) | (kind[pairs.b] == PLANE)
    rows = np.flatnonzero(endless)
    lower[rows], upper[rows] = _plane_distances(pairs.at(rows))
    rows = np.flatnonzero(~endless)
    some, bar = pairs.at(rows), stop[rows] + margins[rows]
    low, high = _core_distances(some, bar)
    meet = np.flatnonzero(high == 0)
    if len(meet):
        met = some.at(meet)
        overlap = _overlaps(met)
        low[meet] = -overlap
        exact = (kind[met.a] <= BOX) & (kind[met.b] <= BOX)
        high[meet[exact]] = -overlap[exact]
        todo = np.flatnonzero(~exact & (overlap > -bar[meet]))
        if deep is not None and len(todo):
            shallow, most = penetration_depths(
                lambda n, way: met.at(todo[n]).farthest(way),
                overlap[todo], -bar[meet[todo]], deep, flat=pairs.flat,
            )  # fmt: skip
            low[meet[todo]], high[meet[todo]] = -most, -shallow
    lower[rows], upper[rows] = low - margins[rows], high - margins[rows]
    return lower, upper


def _core_distances(pairs: Pairs, stop: F64) -> tuple[F64, F64]:
    """Bounds (N,) m without margins, (−inf, 0) where cores meet; above ``stop`` they may be loose."""
    lower, upper = np.full(len(pairs), -np.inf), np.full(len(pairs), np.inf)
    if not len(pairs):
        return lower, upper
    rows, first = np.arange(len(pairs)), pairs.farthest(pairs.gap)
    corners = np.repeat(first[:, None], 4, 1)
    for _ in range(ITERATIONS):
        share, met = _nearest(corners)
        v = (share[:, :, None] * corners).sum(1)
        norm = np.sqrt((v * v).sum(1))
        met |= norm < TOUCHING
        stuck = norm >= upper[rows]
        upper[rows] = np.where(met, 0.0, np.minimum(upper[rows], norm))
        norm[met] = np.inf
        w = pairs.farthest(-v)
        lower[rows] = np.maximum(lower[rows], (v * w).sum(1) / norm)
        gap, above = upper[rows] - lower[rows], lower[rows] - stop
        done = met | stuck | (gap <= TOLERANCE) | ((above >= 0) & (gap <= 0.2 * above + 1e-4))
        going = np.flatnonzero(~(done | (corners == w[:, None]).all(2).any(1)))
        if not len(going):
            break
        rows, pairs, corners, stop = rows[going], pairs.at(going), corners[going], stop[going]
        corners[np.arange(len(going)), share[going].argmin(1)] = w[going]
    lower[upper == 0] = -np.inf
    return np.minimum(lower, upper), upper


def _nearest(corners: F64) -> tuple[F64, Bool]:
    """(N, 4) barycentric weights of the points nearest to the origin of tetrahedra (N, 4, 3).

    And (N,) whether the origin is inside. Corners may coincide. Ericson 2005, "Real-time collision
    detection", ch. 5: by areas and volumes from cross products of edges, which keep their digits.
    """
    a = corners[:, _EDGES[:, 0]]
    d = corners[:, _EDGES[:, 1]] - a
    length = (d * d).sum(-1)
    t = np.divide(-(a * d).sum(-1), length, out=np.zeros_like(length), where=length > 0)
    t = np.minimum(np.maximum(t, 0.0), 1.0)
    p = a + t[..., None] * d
    edge = (p * p).sum(-1)
    a = corners[:, _FACES[:, 0]]
    b, c = corners[:, _FACES[:, 1]] - a, corners[:, _FACES[:, 2]] - a
    n = _cross(b, c)
    square, height = (n * n).sum(-1), (a * n).sum(-1)
    wide = square > 1e-24 * (b * b).sum(-1) * (c * c).sum(-1)
    scale = -1.0 / np.where(wide, square, 1.0)
    beta, gamma = (_cross(a, c) * n).sum(-1) * scale, (_cross(b, a) * n).sum(-1) * scale
    alpha = 1.0 - beta - gamma
    inner = wide & (alpha >= 0) & (beta >= 0) & (gamma >= 0)
    face = np.where(inner, -height * height * scale, np.inf)
    best = np.concatenate([edge, face], 1).argmin(1)
    every, out = np.arange(len(corners)), np.zeros((len(corners), 4))
    row, k = every[best < 6], best[best < 6]
    out[row, _EDGES[k, 0]], out[row, _EDGES[k, 1]] = 1.0 - t[row, k], t[row, k]
    row, k = every[best >= 6], best[best >= 6] - 6
    for corner, weight in enumerate((alpha, beta, gamma)):
        out[row, _FACES[k, corner]] = weight[row, k]
    volume = height * _FACE_SIGNS
    total = volume.sum(1)
    full = np.abs(total) > 1e-14 * np.abs(volume).sum(1)
    return out, full & (volume * np.sign(total)[:, None] > 0).all(1)


def _overlaps(pairs: Pairs) -> F64:
    """(N,) m, upper bounds on how far meeting cores must move to come apart.

    The least overlap over the separating-axis candidates of two boxes (Gottschalk, Lin & Manocha
    1996, "OBBTree"): three axes each and their nine cross products, for which it is exact, as it
    is for points and segments; and the directions between centres, across either z axis too.
    """
    first, second, p = pairs.turn_a.swapaxes(1, 2), pairs.turn_b.swapaxes(1, 2), pairs.gap
    across = _cross(first[:, :, None], second[:, None]).reshape(-1, 9, 3)
    beside = [p - (p * turn[:, 2]).sum(1, keepdims=True) * turn[:, 2] for turn in (first, second)]
    axes = np.concatenate([first, second, across, np.stack([p, *beside], 1)], 1)
    if pairs.flat:
        axes[..., 2] = 0.0
    norm = np.sqrt((axes * axes).sum(-1))
    axes /= np.where(norm < 1e-6, np.inf, norm)[..., None]
    axes = np.concatenate([axes, -axes], 1)
    many = axes.shape[1]
    directions = axes.reshape(-1, 3)
    points = pairs.at(np.repeat(np.arange(len(p)), many)).farthest(directions)
    reach = (points * directions).sum(1)
    used = (directions != 0).any(1)
    return np.asarray(np.where(used, reach, np.inf).reshape(-1, many).min(1))


def _plane_distances(pairs: Pairs) -> tuple[F64, F64]:
    """Bounds (N,) where a or b is a half-space; exact unless both are, or it is flattened aslant."""
    lower, upper = np.full(len(pairs), -np.inf), np.zeros(len(pairs))
    kind = pairs.solids.kind
    for plane, turn, other, beside, sign in (
        (pairs.a, pairs.turn_a, pairs.b, pairs.turn_b, 1.0),
        (pairs.b, pairs.turn_b, pairs.a, pairs.turn_a, -1.0),
    ):
        rows = (kind[plane] == PLANE) & (kind[other] != PLANE)
        if pairs.flat:
            rows &= np.abs(turn[:, 2, 2]) <= 1e-9
        rows = np.flatnonzero(rows)
        normal = turn[rows, :, 2]
        reach = support_values(pairs.solids, other[rows], -_turned_back(beside[rows], normal))
        lower[rows] = upper[rows] = sign * (pairs.gap[rows] * normal).sum(1) - reach
    return lower, upper


def _turned(turn: F64, vectors: F64) -> F64:
    return np.asarray((turn @ vectors[:, :, None])[:, :, 0])


def _turned_back(turn: F64, vectors: F64) -> F64:
    return np.asarray((vectors[:, None] @ turn)[:, 0])


def _cross(a: F64, b: F64) -> F64:
    """Cross products over the last axis, broadcast."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], -1)
