"""The hull of points: against Qhull, and on points where rounding decides."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from safestage_eval.geometry.hull import hull_triangles

RANDOM = np.random.default_rng(5)


def unit(vectors: np.ndarray) -> np.ndarray:
    """(N, 3) of length 1."""
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def lattice(count: int) -> np.ndarray:
    """(count³, 3) a cube of points: most of them lie in faces or within."""
    axis = np.linspace(-1.0, 1.0, count)
    return np.stack(np.meshgrid(axis, axis, axis), -1).reshape(-1, 3)


def drum(corners: int) -> np.ndarray:
    """Two rings and the middle of both lids."""
    angle = 2 * np.pi * np.arange(corners) / corners
    ring = np.stack([np.cos(angle), np.sin(angle)], 1)
    rings = [np.c_[ring, np.full(corners, z)] for z in (-0.5, 0.5)]
    return np.concatenate([*rings, [[0, 0, -0.5], [0, 0, 0.5]]])


CLOUDS = {
    "ball": RANDOM.normal(size=(300, 3)),
    "sphere": unit(RANDOM.normal(size=(400, 3))),
    "needle": RANDOM.normal(size=(200, 3)) * [1.0, 1e-3, 1e-3],
    "single precision": RANDOM.normal(size=(200, 3)).astype(np.float32).astype(np.float64),
    "far away": RANDOM.normal(size=(100, 3)) + 1e3,
    "twice": np.repeat(RANDOM.normal(size=(40, 3)), 2, axis=0),
    "lattice": lattice(4),
    "drum": drum(64),
    "tetrahedron": np.vstack([np.zeros(3), np.eye(3)]),
}


@pytest.mark.parametrize("name", CLOUDS)
def test_it_is_the_hull_that_qhull_finds(name: str) -> None:
    points = CLOUDS[name]
    hull, known = hull_triangles(points), ConvexHull(points)
    assert hull is not None
    faces = hull.corners
    a, b, c = (points[faces[:, i]] for i in range(3))
    inner = points.mean(0)
    volume = np.abs(np.einsum("ij,ij->i", np.cross(a - inner, b - inner), c - inner)).sum() / 6
    assert volume == pytest.approx(known.volume, rel=1e-9)
    spread = np.abs(points - inner).max()
    above = points @ known.equations[:, :3].T + known.equations[:, 3]
    outer = np.flatnonzero(above.max(1) > -1e-9 * spread)
    assert set(np.unique(faces)) <= set(outer)
    directions = RANDOM.normal(size=(200, 3))
    corners = points[np.unique(faces)]
    reach = (directions @ (points - inner).T).max(1)
    assert (directions @ (corners - inner).T).max(1) == pytest.approx(reach, abs=1e-9 * spread)


@pytest.mark.parametrize("name", ["ball", "drum", "lattice", "single precision"])
def test_each_edge_belongs_to_two_triangles(name: str) -> None:
    hull = hull_triangles(CLOUDS[name])
    assert hull is not None
    edges = np.sort(hull.corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), 1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    assert (counts == 2).all()


def test_flat_points_have_none() -> None:
    flat = RANDOM.normal(size=(50, 3)) * [1.0, 1.0, 0.0]
    assert hull_triangles(flat) is None
    assert hull_triangles(flat[:3]) is None
    assert hull_triangles(np.zeros((5, 3))) is None


def test_turning_the_points_turns_the_hull() -> None:
    points = CLOUDS["single precision"]
    turn, _ = np.linalg.qr(RANDOM.normal(size=(3, 3)))
    before, after = hull_triangles(points), hull_triangles(points @ turn)
    assert before is not None
    assert after is not None
    assert {frozenset(face) for face in before.corners.tolist()} == {
        frozenset(face) for face in after.corners.tolist()
    }


@pytest.mark.parametrize("name", CLOUDS)
def test_planes_hold_their_triangles_and_all_points(name: str) -> None:
    points = CLOUDS[name]
    hull = hull_triangles(points)
    assert hull is not None
    normal, offset = hull.planes[:, :3], hull.planes[:, 3]
    assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0, abs=1e-12)
    size = np.abs(points).max()
    assert (normal @ points.T + offset[:, None]).max() <= 1e-11 * size
    own = np.einsum("fc,fkc->fk", normal, points[hull.corners]) + offset[:, None]
    assert np.abs(own).max() <= 1e-11 * size


def test_qhull_answers_where_rounding_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("safestage_eval.geometry.hull._wrap", lambda *_: 0)
    hull = hull_triangles(CLOUDS["drum"])
    assert hull is not None
    assert set(np.unique(hull.corners)) == set(range(128))
