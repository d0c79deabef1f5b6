"""Seen from above: overlap and horizontal distance."""

from __future__ import annotations

import time

import numpy as np
import pytest
from bodies import any_shape, box, cylinder, put, shape, sphere, wanderer
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.episode import Geom, Mesh
from safestage_eval.geometry.footprint import overlap_xy
from safestage_eval.geometry.group_clearance import clearance_series
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.polygon import contains, convex_hull, edges, nearest_on, union_area
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


def plain_share(a: Mover, b: Mover, frame: int) -> float:
    """Three areas of unions, all outlined whole."""
    over, under = footprint(a, frame), footprint(b, frame)
    area = union_area(over)
    if area <= 0:
        return np.nan
    return (area + union_area(under) - union_area(over + under)) / area


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


def test_only_what_was_asked_for_and_rest_is_reused() -> None:
    p = np.zeros((10, 3))
    p[5:, 0] = 0.05
    mover = put(CUBE, p, np.tile([1.0, 0, 0, 0], (10, 1)))
    share = overlap_xy(mover, put(CUBE, (0, 0, 0)), np.array([3, 4, 5]))
    np.testing.assert_allclose(share[3:6], [1, 1, 0.5])
    assert np.isnan(share[[0, 1, 2, 6, 7, 8, 9]]).all()


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, deadline=None, max_examples=25)
def test_overlap_agrees_with_areas_of_unions(seed: int) -> None:
    """Bodies of one, several and many geoms, near each other, apart and inside each other."""
    rng = np.random.default_rng(seed)
    a = wanderer(rng, 30, 0.25, int(rng.choice([1, 1, 2, 6])))
    pose = (rng.normal(size=3) * 0.05, rng.normal(size=4))
    b = put(any_shape(rng, int(rng.choice([1, 1, 2, 12]))), *pose)
    if rng.random() < 0.3:
        a, b = b, a
    share = overlap_xy(a, b)
    for t in range(len(share)):
        assert share[t] == pytest.approx(plain_share(a, b, t), abs=1e-6, nan_ok=True)


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, deadline=None, max_examples=10)
def test_overlap_agrees_with_counting_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = (put(any_shape(rng, 2), rng.normal(size=3) * 0.03) for _ in range(2))
    side = np.linspace(-0.3, 0.3, 601)
    grid = np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)
    over, under = (contains(footprint(one, 0), grid) for one in (a, b))
    assert overlap_xy(a, b)[0] == pytest.approx((over & under).sum() / over.sum(), abs=0.01)


def test_copies_and_what_lies_inside_change_nothing() -> None:
    rng = np.random.default_rng(4)
    own = [disc(0.03, at) for at in rng.uniform(-0.05, 0.05, (4, 3))]
    inside = [disc(0.01, geom.position) for geom in own]
    poses = rng.uniform(-0.05, 0.05, (8, 3)), rng.normal(size=(8, 4))
    for more in (own * 12, inside, [*inside, *own[::-1]]):
        whole, plain = put(shape(*own, *more), *poses), put(shape(*own), *poses)
        for under in (put(CUBE, (0.04, 0, 0)), put(shape(CUBE, CUBE), (0.04, 0, 0))):
            assert overlap_xy(whole, under) == pytest.approx(overlap_xy(plain, under), abs=1e-9)
            assert overlap_xy(under, whole) == pytest.approx(overlap_xy(under, plain), abs=1e-9)


@pytest.mark.parametrize("kind", ["copies", "a heap", "a net"])
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
    overlap_xy(put(CUBE, (0, 0, 1)), put(shape(CUBE, CUBE), (0, 0, 0)))  # compiles
    began = time.process_time()
    share = overlap_xy(moving, put(CUBE, (0.02, 0, 0)))
    assert time.process_time() - began < 5
    middle = moving.position[7, :2] + places[:, :2].mean(0)
    points = middle + rng.uniform(-1, 1, (20_000, 2)) * (0.02 + np.ptp(places[:, :2], 0) / 2)
    over = contains(footprint(moving, 7), points)
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


def test_what_covers_nothing_has_no_share() -> None:
    flat = put(Geom(kind="plane"), (0, 0, 0))
    assert np.isnan(overlap_xy(flat, put(CUBE, (0, 0, 0)))[0])
    with pytest.raises(ValueError, match="norm 0 or is not finite"):
        overlap_xy(put(CUBE, (0, 0, 0), (0, 0, 0, 0)), put(CUBE, (0, 0, 0)))


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


@given(st.integers(0, 2**32 - 1))
@settings(derandomize=True, deadline=None, max_examples=6)
def test_horizontal_distance_agrees_with_the_outlines(seed: int) -> None:
    """Against polygons of the projections, which are right to 0.1 mm on either side."""
    rng = np.random.default_rng(seed)
    a, b = wanderer(rng, 40, 0.4, 2), put(any_shape(rng, 2), (0, 0, 0))
    found = clearance_series([a], [b], flat=True)
    capped = clearance_series([a], [b], 0.1, flat=True)
    for t in range(0, 40, 5):
        least = np.inf
        for one in footprint(a, t):
            for other in footprint(b, t):
                least = min(
                    least,
                    nearest_on(one, edges(other)).distance.min(),
                    nearest_on(other, edges(one)).distance.min(),
                )
        if found.upper[t] <= 0:
            continue
        assert found.upper[t] - found.lower[t] <= 1e-9 or found.lower[t] < 1e-5
        assert found.lower[t] - 1e-9 <= least <= found.upper[t] + 2e-4
        if found.lower[t] > 0.1 + 1e-9:
            assert capped.upper[t] == np.inf
        else:
            assert capped.upper[t] == pytest.approx(found.upper[t], abs=2e-9)


def test_outlines_of_round_things_are_right_to_a_tenth_of_a_millimetre() -> None:
    for geom, radius in ((sphere(0.05), 0.05), (cylinder(0.15, 0.01), 0.15)):
        outline = footprint(put(geom, (1, 2, 3)), 0)[0]
        assert len(convex_hull(outline)) == len(outline)
        middles = (outline + np.roll(outline, 1, 0)) / 2
        assert np.linalg.norm(middles - [1, 2], axis=1).min() > radius - 1e-4
        assert np.linalg.norm(outline - [1, 2], axis=1).max() < radius + 1e-12
