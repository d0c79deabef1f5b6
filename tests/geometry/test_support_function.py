"""Large hulls are searched along their edges: the answer is that of looking at every vertex."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import put, shape

from safestage_eval.episode import Geom, Mesh
from safestage_eval.geometry import shape as shapes
from safestage_eval.geometry.group_clearance import clearance_series
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.shape import BodyShape
from safestage_eval.geometry.support_function import support_value


def hull(points: np.ndarray) -> BodyShape:
    mesh = Mesh.build(points)
    return shape(Geom(kind="convex_mesh", mesh=mesh.key), meshes={mesh.key: mesh})


def egg(rng: np.random.Generator, count: int) -> np.ndarray:
    v = rng.normal(size=(count, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True) * np.array([0.05, 0.08, 0.1])


def drum(count: int) -> np.ndarray:
    """Flat ends of many corners, straight edges between them."""
    angle = 2 * np.pi * np.arange(count) / count
    ring = np.stack([np.cos(angle), np.sin(angle)], 1) * 0.05
    return np.concatenate([np.c_[ring, np.full(count, z)] for z in (-0.1, 0.1)])


def needle(rng: np.random.Generator, count: int) -> np.ndarray:
    return egg(rng, count) * np.array([1e-3, 1e-2, 10])


@pytest.mark.parametrize("kind", ["egg", "large egg", "drum", "needle"])
def test_no_vertex_lies_farther(kind: str) -> None:
    rng = np.random.default_rng(1)
    points = {
        "egg": egg(rng, 300), "large egg": egg(rng, 4000), "drum": drum(200),
        "needle": needle(rng, 500),
    }[kind]  # fmt: skip
    body = hull(points)
    assert len(body.solids.beside) > 0
    vertices, scratch = body.solids.vertices, np.empty(3)
    directions = rng.normal(size=(2000, 3))
    directions[:300, 2], directions[300:600, :2] = 0, 0
    directions[600:900] *= (1, 1, 1e-4)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for d in directions:
        found = support_value(body.solids, 0, *map(float, d), scratch)
        assert found == pytest.approx((vertices @ d).max(), abs=1e-15)


def test_distances_are_those_of_the_plain_search(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(2)
    points = [egg(rng, 1000), drum(100)]
    place, turn = rng.normal(size=(200, 3)) * 0.15, rng.normal(size=(200, 4))

    def measured() -> tuple[Mover, Mover]:
        for memory in (shapes._SHAPES, shapes._HULL_POINTS, shapes._GRAPHS):
            memory.clear()
        return put(hull(points[0]), place, turn), put(hull(points[1]), (0, 0, 0))

    a, b = measured()
    fast = clearance_series([a], [b], deep=True)
    monkeypatch.setattr(shapes, "MANY_CORNERS", 10**9)
    a, b = measured()
    assert len(a.shape.solids.beside) == 0
    plain = clearance_series([a], [b], deep=True)
    assert (fast.lower <= plain.upper + 1e-14).all()
    assert (plain.lower <= fast.upper + 1e-14).all()
