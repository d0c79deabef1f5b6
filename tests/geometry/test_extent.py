"""Reach, lowest and highest points against analytic values and against the polytopes."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import KINDS, any_geom, any_shape, box, cylinder, put, shape, sphere
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.episode import Geom, Mesh
from safestage_eval.geometry import pose
from safestage_eval.geometry.extent import farthest_point, highest, lowest, reach
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


def test_a_floor_has_a_top_and_no_bottom() -> None:
    floor = put(Geom(kind="plane"), (0, 0, 0.2))
    assert highest(floor)[0] == pytest.approx(0.2)
    assert lowest(floor)[0] == -np.inf
    assert highest(put(Geom(kind="plane"), (0, 0, 0), LYING))[0] == np.inf


def test_over_time_each_frame_is_its_own() -> None:
    rng = np.random.default_rng(0)
    p, q = rng.normal(size=(40, 3)), rng.normal(size=(40, 4))
    a = any_shape(rng)
    whole = lowest(put(a, p, q))
    for t in (0, 7, 39):
        assert whole[t] == lowest(put(a, p[t], q[t]))[0]
    d = rng.normal(size=(40, 3))
    assert reach(put(a, p[0], q[0]), d).shape == (40,)


def test_what_keeps_its_turn_for_a_while_reaches_as_far_as_in_each_frame_alone() -> None:
    rng = np.random.default_rng(1)
    p, q = rng.normal(size=(40, 3)), np.repeat(rng.normal(size=(8, 4)), 5, axis=0)
    q[20:] = q[20]
    a = any_shape(rng)
    for part in (slice(40), slice(0, 1)):
        for d in (rng.normal(size=3), rng.normal(size=(40, 3))):
            whole = reach(put(a, p[part], q[part]), d)
            for t in range(len(whole)):
                s = min(t, part.stop - 1)
                assert whole[t] == reach(put(a, p[s], q[s]), d if d.ndim == 1 else d[t])[0]


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


@given(st.integers(0, 2**32 - 1))
@few
def test_the_farthest_point_is_as_far_as_the_body_reaches(seed: int) -> None:
    """Up to what a face tilted by less than FLAT hides."""
    rng = np.random.default_rng(seed)
    mover = put(any_shape(rng), rng.normal(size=3), rng.normal(size=4))
    d = rng.normal(size=(50, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    along = (farthest_point(mover, d) * d).sum(1)
    short = reach(mover, d) - along
    assert short.min() > -1e-12
    assert short.max() <= 0.02 * 2 * mover.shape.radius


def test_of_a_flat_bottom_the_middle() -> None:
    for geom in (box(0.05, 0.04, 0.03), cylinder(0.05, 0.03)):
        tilt = (1.0, 0.004, -0.003, 0.0)
        low = farthest_point(put(geom, (1, 2, 3), tilt), (0, 0, -1))[0]
        np.testing.assert_allclose(low[:2], [1, 2], atol=1e-3)


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
