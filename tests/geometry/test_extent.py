"""Reach, lowest and highest points against analytic values and against the polytopes."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import KINDS, any_geom, box, cylinder, put, shape, sphere
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.episode import Geom, Mesh
from safestage_eval.geometry import pose
from safestage_eval.geometry.extent import highest, lowest, reach
from safestage_eval.geometry.shape import BodyShape

few = settings(derandomize=True, deadline=None, max_examples=10)
LYING = (np.cos(np.pi / 4), np.sin(np.pi / 4), 0, 0)


def test_truths() -> None:
    can = put(cylinder(0.03, 0.06), (1, 2, 0.5))
    assert lowest(can)[0] == pytest.approx(0.44)
    assert highest(can)[0] == pytest.approx(0.56)
    assert highest(put(cylinder(0.03, 0.06), (1, 2, 0.5), LYING))[0] == pytest.approx(0.53)
    assert reach(can, (2, 0, 0))[0] == pytest.approx(1.03)
    rod = put(Geom(kind="capsule", size=(0.02, 0.1)), (0, 0, 0))
    assert lowest(rod)[0] == pytest.approx(-0.12)
    egg = put(Geom(kind="ellipsoid", size=(0.02, 0.03, 0.05)), (0, 0, 0))
    d = np.array([1.0, 2.0, 2.0]) / 3
    assert reach(egg, d)[0] == pytest.approx(np.sqrt(0.02**2 + 0.06**2 + 0.1**2) / 3)


@given(st.integers(0, 2**32 - 1))
@few
def test_polytopes_lie_within_a_tenth_of_a_millimetre(seed: int) -> None:
    rng = np.random.default_rng(seed)
    meshes: dict[str, Mesh] = {}
    for kind in KINDS:
        body = shape(any_geom(rng, kind, meshes), meshes=meshes)
        part = body.polytopes[0]
        assert part is not None
        p, q = rng.normal(size=3), pose.unit(rng.normal(size=4))
        world = pose.transform(p, q, part.vertices)
        d = rng.normal(size=(200, 3))
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        over = reach(put(body, p, q), d) - (world @ d.T).max(0)
        assert over.min() > -1e-12
        assert over.max() < 1e-4
        for face in part.faces:
            a, b, c = part.vertices[face[:3]]
            normal = np.cross(b - a, c - a)
            assert ((part.vertices - a) @ normal).max() <= 1e-6 * np.linalg.norm(normal)


def build(*geoms: Geom) -> BodyShape:
    return shape(*geoms)


def test_centroids() -> None:
    np.testing.assert_allclose(build(sphere(0.1)).centroid, 0)
    hammer = build(box(0.1, 0.01, 0.01), box(0.01, 0.01, 0.05, at=(0.1, 0, 0)))
    assert 0 < hammer.centroid[0] < 0.11
    moved = build(box(0.02, 0.02, 0.02, at=(1, 2, 3)), box(0.02, 0.02, 0.02, at=(1.1, 2, 3)))
    np.testing.assert_allclose(moved.centroid, [1.05, 2, 3], atol=1e-12)
    wedge = Mesh.build([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    tetra = shape(Geom(kind="convex_mesh", mesh=wedge.key), meshes={wedge.key: wedge})
    np.testing.assert_allclose(tetra.centroid, 0.25, atol=1e-7)
    with pytest.raises(ValueError, match="no hull"):
        _ = build(Geom(kind="plane")).centroid
