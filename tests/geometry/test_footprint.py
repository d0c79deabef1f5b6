"""Seen from above: overlap and horizontal distance."""

from __future__ import annotations

import time

import numpy as np
import pytest
import shapely
from bodies import any_shape, box, cylinder, put, shape, sphere
from hypothesis import given, settings
from hypothesis import strategies as st
from sampled import share

from safestage_eval.episode import Geom, Mesh
from safestage_eval.geometry.footprint import overlap_xy
from safestage_eval.geometry.group_clearance import clearance_series
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.polygon import convex_hull
from safestage_eval.geometry.pose import transform

CUBE = box(0.05, 0.05, 0.05)


def disc(radius: float, at: np.ndarray) -> Geom:
    return Geom(kind="cylinder", size=(radius, 0.01), position=tuple(map(float, at)))


def footprint(mover: Mover, frame: int) -> list[np.ndarray]:
    """One convex polygon per geom, one per triangle of a nonconvex mesh, piece by piece."""
    t, found = frame if len(mover) > 1 else 0, []
    for part in mover.shape.polytopes:
        if part is not None:
            points = transform(mover.position[t], mover.orientation[t], part.vertices)
            corners = [points] if part.convex else [points[face] for face in part.faces]
            found += [convex_hull(c[:, :2]) for c in corners]
    return found


def union(polygons: list[np.ndarray]) -> shapely.Geometry:
    return shapely.union_all([shapely.Polygon(one) for one in polygons if len(one) > 2])


def covered(polygons: list[np.ndarray], points: np.ndarray) -> np.ndarray:
    whole = union(polygons)
    shapely.prepare(whole)
    return shapely.intersects_xy(whole, *points.T)


def test_overlap_truths() -> None:
    under = put(CUBE, (0, 0, 0))
    assert overlap_xy(put(CUBE, (0.05, 0, 1)), under)[0] == pytest.approx(0.5)
    assert overlap_xy(put(CUBE, (0.025, 0.025, 1)), under)[0] == pytest.approx(0.5625)
    assert overlap_xy(put(CUBE, (0.2, 0, 1)), under)[0] == 0
    assert overlap_xy(put(CUBE, (0.2, 0, 1)), put(Geom(kind="plane"), (0, 0, 0)))[0] == 1
    assert overlap_xy(put(cylinder(0.03, 0.1), (0, 0, 1)), under)[0] == 1
    can, board = put(cylinder(0.03, 0.1), (0.05, 0, 1)), put(box(0.05, 0.5, 0.1), (0, 0, 0))
    assert overlap_xy(can, board)[0] == pytest.approx(0.5, abs=1e-9)
    shelf = put(shape(box(0.05, 0.1, 0.1), box(0.05, 0.1, 0.1, at=(0.1, 0, 0))), (0, 0, 0))
    assert overlap_xy(put(CUBE, (0.05, 0, 1)), shelf)[0] == pytest.approx(1)


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, deadline=None, max_examples=10)
def test_overlap_agrees_with_counting_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = (put(any_shape(rng, 2), rng.normal(size=3) * 0.03) for _ in range(2))
    side = np.linspace(-0.3, 0.3, 601)
    grid = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    over, under = (covered(footprint(one, 0), grid) for one in (a, b))
    assert overlap_xy(a, b)[0] == pytest.approx((over & under).sum() / over.sum(), abs=0.01)


@pytest.mark.parametrize("kind", share(["copies", "a heap", "a net"], 3))
def test_a_body_of_hundreds_of_shapes_takes_no_minutes(kind: str) -> None:
    """A second or so for 300 round shapes at thirty poses, where every side was compared with every side."""
    rng = np.random.default_rng(5)
    places = {
        "copies": np.zeros((300, 3)),
        "a heap": rng.uniform(-0.05, 0.05, (300, 3)),
        "a net": np.stack(np.meshgrid(np.arange(20), np.arange(15), [0]), -1).reshape(-1, 3) * 0.02,
    }[kind]
    many = shape(*(disc(0.012, at) for at in places))
    moving = put(many, rng.uniform(-0.05, 0.05, (30, 3)), np.tile([1.0, 0, 0, 0], (30, 1)))
    began = time.process_time()
    share = overlap_xy(moving, put(CUBE, (0.02, 0, 0)))
    assert time.process_time() - began < 5
    middle = moving.position[7, :2] + places[:, :2].mean(0)
    points = middle + rng.uniform(-1, 1, (20_000, 2)) * (0.02 + np.ptp(places[:, :2], 0) / 2)
    over = covered(footprint(moving, 7), points)
    under = np.abs(points - [0.02, 0]).max(1) <= 0.05
    assert share[7] == pytest.approx((over & under).sum() / over.sum(), abs=0.03)


def test_overlap_of_an_open_mesh_is_that_of_its_triangles() -> None:
    """A square ring of eight triangles: what lies over the hole is not over it."""
    outer, inner = 0.1 * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]), 0.05
    corners = np.concatenate([outer, outer / 0.1 * inner])
    faces = [
        f
        for i in range(4)
        for f in ((i, (i + 1) % 4, 4 + i), ((i + 1) % 4, 4 + (i + 1) % 4, 4 + i))
    ]
    mesh = Mesh.build(np.c_[corners, np.zeros(8)], np.array(faces))
    ring = put(shape(Geom(kind="mesh", mesh=mesh.key), meshes={mesh.key: mesh}), (0, 0, 0))
    turned = (np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8))
    assert overlap_xy(put(CUBE, (0, 0, 1)), ring)[0] == pytest.approx(0, abs=1e-6)
    assert overlap_xy(put(CUBE, (0.05, 0, 1)), ring)[0] == pytest.approx(0.5, abs=1e-6)
    small = put(box(0.02, 0.02, 0.02), (0.075, 0, 1), turned)
    expected = 1 - 2 * (0.02 * np.sqrt(2) - 0.025) ** 2 / 0.04**2
    assert overlap_xy(small, ring)[0] == pytest.approx(expected, abs=1e-6)
    assert overlap_xy(ring, put(CUBE, (0, 0, -1)))[0] == pytest.approx(0, abs=1e-6)
    assert overlap_xy(ring, put(CUBE, (0.1, 0, -1)))[0] == pytest.approx(0.005 / 0.03, abs=1e-6)


def test_horizontal_distance_truths() -> None:
    def xy(a: object, b: object) -> tuple[float, float]:
        found = clearance_series([a], [b], flat=True)
        return float(found.lower[0]), float(found.upper[0])

    lower, upper = xy(put(sphere(0.03), (0.1, 0, 5)), put(sphere(0.03), (0, 0, 0)))
    assert lower - 1e-12 <= 0.04 <= upper + 1e-12
    lower, upper = xy(put(CUBE, (0.13, 0.14, 5)), put(CUBE, (0, 0, 0)))
    assert lower - 1e-12 <= 0.05 <= upper + 1e-12
    lying = (np.cos(np.pi / 4), np.sin(np.pi / 4), 0, 0)
    lower, upper = xy(put(cylinder(0.03, 0.1), (0.2, 0, 5), lying), put(CUBE, (0, 0, 0)))
    assert lower - 1e-12 <= 0.2 - 0.05 - 0.03 <= upper + 1e-12
    assert xy(put(CUBE, (0.05, 0, 1)), put(CUBE, (0, 0, 0)))[1] <= 0
    assert xy(put(CUBE, (9, 0, 1)), put(Geom(kind="plane"), (0, 0, 0)))[1] <= 0
