"""Clearance: analytic truths, agreement with independent solvers, laws, and exact pruning."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import fcl
import numpy as np
import pytest
from bodies import KINDS, any_geom, any_shape, box, cylinder, put, shape, sphere, wanderer
from hypothesis import given, settings
from hypothesis import strategies as st
from plain import solid

from safestage_eval.episode import Geom, Mesh
from safestage_eval.geometry import pose
from safestage_eval.geometry.gjk import Pairs, distances
from safestage_eval.geometry.group_clearance import (
    Clearance,
    clearance_series,
    motion_bound,
)
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.shape import stacked

seeds = st.integers(0, 2**32 - 1)
ULPS = 1e-13
"""m. Bounds hold to float64 rounding."""

few = settings(derandomize=True, deadline=None, max_examples=8)


def between(a: Mover, b: Mover, **options: object) -> tuple[float, float]:
    found = clearance_series([a], [b], **options)
    return float(found.lower[0]), float(found.upper[0])


def plain(a: Sequence[Mover], b: Sequence[Mover]) -> Clearance:
    """Every frame, every pair, every geom, from scratch: what pruning must not change."""
    frames = max(len(m) for m in (*a, *b))
    lower, upper = np.full(frames, np.inf), np.full(frames, np.inf)
    for first, second in product(a, b):
        solids = stacked([first.shape.solids, second.shape.solids])
        i, j = (m.rows(np.arange(frames)) for m in (first, second))
        turns = pose.matrix(first.turn[i]), pose.matrix(second.turn[j])
        many = len(first.shape)
        for g, h in product(range(many), range(many, many + len(second.shape))):
            p = [turn @ solids.offset[k] + mover.centre[row] for turn, k, mover, row in zip(
                turns, (g, h), (first, second), (i, j), strict=True)]  # fmt: skip
            pairs = Pairs(
                solids, np.full(frames, g), np.full(frames, h), turns[0] @ solids.rotation[g],
                turns[1] @ solids.rotation[h], p[1] - p[0], flat=False,
            )  # fmt: skip
            low, high = distances(pairs, np.full(frames, np.inf), None)
            lower, upper = np.minimum(lower, low), np.minimum(upper, high)
    return Clearance(lower, upper)


CUBE, UNIT = box(0.05, 0.05, 0.05), box(0.5, 0.5, 0.5)
EGG = Geom(kind="ellipsoid", size=(0.02, 0.03, 0.05))
ROD = Geom(kind="capsule", size=(0.02, 0.1))
FLOOR = Geom(kind="plane")
SIDE = (np.cos(np.pi / 4), 0.0, np.sin(np.pi / 4), 0.0)
HALF_TURN_45 = (np.cos(np.pi / 8), 0.0, 0.0, np.sin(np.pi / 8))

TRUTHS = [
    # python-fcl 0.7 says 3.1623, .2236 and .1811 in the first three
    ("unit boxes along y", put(UNIT, (0, 0, 0)), put(UNIT, (0, 4, 0)), 3.0),
    ("cubes 30 cm apart", put(CUBE, (0, 0, 0)), put(CUBE, (0, 0.3, 0)), 0.2),
    (
        "cylinders side by side",
        put(cylinder(0.03, 0.05), (0, 0, 0)),
        put(cylinder(0.05, 0.15), (-0.1, 0, 0.02)),
        0.02,
    ),
    (
        "cylinders stacked",
        put(cylinder(0.03, 0.05), (0, 0, 0.3)),
        put(cylinder(0.05, 0.15), (0, 0, 0)),
        0.1,
    ),
    ("boxes edge to edge", put(CUBE, (0, 0, 0)), put(CUBE, (0.13, 0.14, 0)), 0.05),
    ("boxes corner to corner", put(CUBE, (0, 0, 0)), put(CUBE, (0.11, 0.12, 0.12)), 0.03),
    (
        "box edge to face",
        put(CUBE, (0, 0, 0)),
        put(CUBE, (0.2, 0, 0), HALF_TURN_45),
        0.15 - 0.05 * np.sqrt(2),
    ),
    ("spheres", put(sphere(0.03), (0, 0, 0)), put(sphere(0.05), (0, 0.1, 0)), 0.02),
    ("spheres, deep", put(sphere(0.03), (0, 0, 0)), put(sphere(0.05), (0, 0.01, 0)), -0.07),
    ("spheres, one centre", put(sphere(0.03), (0, 0, 0)), put(sphere(0.05), (0, 0, 0)), -0.08),
    ("sphere and box corner", put(sphere(0.02), (0.08, 0.09, 0.05)), put(CUBE, (0, 0, 0)), 0.03),
    ("sphere inside box", put(sphere(0.01), (0, 0, 0.03)), put(CUBE, (0, 0, 0)), -0.03),
    ("capsules crossing", put(ROD, (0, 0, 0)), put(ROD, (0, 0.1, 0), SIDE), 0.06),
    ("capsules crossing, touching cores", put(ROD, (0, 0, 0)), put(ROD, (0, 0, 0), SIDE), -0.04),
    ("capsules in line", put(ROD, (0, 0, 0)), put(ROD, (0, 0, 0.3)), 0.06),
    ("boxes, 1 mm deep", put(CUBE, (0, 0, 0)), put(CUBE, (0.02, 0.01, 0.099)), -0.001),
    ("boxes, one centre", put(CUBE, (0, 0, 0)), put(CUBE, (0, 0, 0)), -0.1),
    ("ellipsoid over a plane", put(EGG, (3, 2, 0.07)), put(FLOOR, (0, 0, 0)), 0.02),
    ("ellipsoid lying, plane", put(EGG, (3, 2, 0.07), SIDE), put(FLOOR, (0, 0, 0)), 0.05),
    ("plane under a box, deep", put(FLOOR, (0, 0, 0)), put(CUBE, (9, 0, -0.02)), -0.07),
    ("capsule over a plane", put(ROD, (0, 0, 0.5)), put(FLOOR, (0, 0, 0)), 0.38),
    ("ellipsoids, long axes in line", put(EGG, (0, 0, 0)), put(EGG, (0, 0, 0.15)), 0.05),
]


@pytest.mark.parametrize(("a", "b", "truth"), [t[1:] for t in TRUTHS], ids=[t[0] for t in TRUTHS])
def test_truth(a: Mover, b: Mover, truth: float) -> None:
    for lower, upper in (between(a, b), between(b, a)):
        assert lower <= upper
        assert upper - lower <= 1e-9
        assert lower - 1e-12 <= truth <= upper + 1e-12


@pytest.mark.parametrize("gap", [1e-5, 1e-6, 1e-8, 1e-12])
@pytest.mark.parametrize("geom", [CUBE, cylinder(0.05, 0.05), EGG, sphere(0.05)])
def test_near_touching(geom: Geom, gap: float) -> None:
    half = geom.size[-1] if len(geom.size) > 1 else geom.size[0]
    lower, upper = between(put(geom, (0.3, 0.2, half)), put(CUBE, (0.3, 0.2, -0.05 - gap)))
    assert lower <= gap + 1e-15
    assert upper >= gap - 1e-15
    assert upper - lower <= (1e-9 if gap >= 1e-8 else 1e-6)


@pytest.mark.parametrize("first", KINDS)
def test_bounds_are_tight_and_symmetric_for_every_kind(first: str) -> None:
    rng = np.random.default_rng(KINDS.index(first))
    n = 200
    for second in KINDS:
        meshes: dict[str, Mesh] = {}
        a, b = (shape(any_geom(rng, kind, meshes), meshes=meshes) for kind in (first, second))
        p, q = rng.normal(size=(n, 3)) * 0.1, rng.normal(size=(n, 3)) * 0.1
        ma, mb = put(a, p, rng.normal(size=(n, 4))), put(b, q, rng.normal(size=(n, 4)))
        forth, back = clearance_series([ma], [mb]), clearance_series([mb], [ma])
        assert (forth.lower <= forth.upper).all()
        apart = forth.upper > 1e-5
        assert (forth.upper - forth.lower)[apart].max() <= 1e-9
        assert (forth.lower <= back.upper + ULPS).all()
        assert (back.lower <= forth.upper + ULPS).all()


@given(seeds)
@few
def test_moving_everything_changes_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = wanderer(rng, 60, 0.2), wanderer(rng, 60, 0.2)
    shift, turn = rng.normal(size=3), pose.unit(rng.normal(size=4))
    moved = [Mover(m.shape, *pose.compose(shift, turn, m.position, m.orientation)) for m in (a, b)]
    here, there = clearance_series([a], [b]), clearance_series(moved[:1], moved[1:])
    assert (here.lower <= there.upper + 1e-12).all()
    assert (there.lower <= here.upper + 1e-12).all()


@given(seeds)
@few
def test_moving_apart_along_the_gap_adds_what_was_moved(seed: int) -> None:
    """Farther away along the separating direction, a distance grows by exactly that much."""
    rng = np.random.default_rng(seed)
    a, b = any_shape(rng, 1), any_shape(rng, 1)
    away = rng.normal(size=3)
    away /= np.linalg.norm(away)
    last = -np.inf
    for k in np.linspace(0.15, 0.5, 8):
        lower, upper = between(put(a, (0, 0, 0)), put(b, away * k))
        assert upper >= last
        last = lower - ULPS
    step = 0.05
    near, far = (
        between(put(a, (0, 0, 0)), put(b, away)),
        between(put(a, (0, 0, 0)), put(b, away * (1 + step))),
    )
    assert far[0] - near[1] <= step + 1e-12


@given(seeds)
@few
def test_pruning_changes_no_answer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    frames = int(rng.integers(1, 100))
    a = [wanderer(rng, frames, 0.15, int(rng.integers(1, 4))) for _ in range(2)]
    b = [wanderer(rng, frames, 0.15, 2), wanderer(rng, 1, 0.15, 2)]
    b.append(put(Geom(kind="plane"), (0, 0, -0.1)))
    truth = plain(a, b)
    whole = clearance_series(a, b)
    assert (whole.lower <= truth.upper + ULPS).all()
    assert (truth.lower <= whole.upper + ULPS).all()
    np.testing.assert_array_less((whole.upper - whole.lower)[truth.lower > 1e-5], 1e-9)
    for cap in (0.0, 0.02, 0.1):
        capped = clearance_series(a, b, cap)
        below = truth.upper < cap
        assert (capped.upper[below] <= truth.upper[below] + 1e-9).all()
        assert (capped.upper >= truth.lower - ULPS).all()
        assert (capped.lower <= truth.upper + ULPS).all()
        tight = below & (truth.lower > 1e-5)
        assert ((capped.upper - capped.lower)[tight] <= 1e-9).all()
        above = truth.lower > cap + 1e-9
        assert (capped.upper[above] == np.inf).all()
        assert (capped.lower[above] == cap).all()
    loose = clearance_series(a, b, slack=1e-5)
    assert (loose.lower <= truth.upper + ULPS).all()
    assert (truth.lower <= loose.upper + ULPS).all()
    assert ((loose.upper - loose.lower)[truth.lower > 1e-4] <= 2.1e-5).all()


@given(seeds)
@few
def test_no_distance_changes_by_more_than_the_motion_bound(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = wanderer(rng, 80, 0.2), wanderer(rng, 80, 0.2)
    found, bound = clearance_series([a], [b]), motion_bound(a, b)
    apart = (found.lower > 1e-5)[1:] & (found.lower > 1e-5)[:-1]
    change = np.abs(np.diff(found.upper))
    assert (change[apart] <= bound[apart] + 1e-8).all()
    np.testing.assert_allclose(motion_bound(a) + motion_bound(b), bound)
    assert motion_bound(put(CUBE, (0, 0, 0)), a).shape == (79,)
    still = put(
        any_shape(rng),
        np.tile(np.float32([0.1, 0.2, 0.3]), (9, 1)),
        np.tile(np.float32([0.3, 0.2, 0.9, 0.1]), (9, 1)),
    )
    assert (motion_bound(still) == 0).all()


def test_agrees_with_fcl() -> None:
    """A few thousand random pairs against python-fcl, which is within 0.1 mm in all but few of them."""
    rng, n, off = np.random.default_rng(7), 120, []
    for i, first in enumerate(KINDS):
        for second in KINDS[i:]:
            meshes: dict[str, Mesh] = {}
            ga, gb = any_geom(rng, first, meshes), any_geom(rng, second, meshes)
            place = {"position": (0, 0, 0), "orientation": (1, 0, 0, 0)}
            ga, gb = ga.model_copy(update=place), gb.model_copy(update=place)
            qa, qb = pose.unit(rng.normal(size=(n, 4))), pose.unit(rng.normal(size=(n, 4)))
            pb = rng.normal(size=(n, 3)) * 0.15
            found = clearance_series(
                [put(shape(ga, meshes=meshes), np.zeros((n, 3)), qa)],
                [put(shape(gb, meshes=meshes), pb, qb)],
            )
            theirs = [fcl.CollisionObject(solid(geom, meshes)) for geom in (ga, gb)]
            for t in np.flatnonzero(found.lower > 1e-4):
                theirs[0].setTransform(fcl.Transform(pose.matrix(qa[t]), np.zeros(3)))
                theirs[1].setTransform(fcl.Transform(pose.matrix(qb[t]), pb[t]))
                there = fcl.distance(*theirs)
                off.append(max(found.lower[t] - there, there - found.upper[t], 0.0))
    assert len(off) > 1000
    assert np.mean(np.array(off) < 1e-4) > 0.99
    assert max(off) < 1e-3


PRIMITIVES = [kind for kind in KINDS if kind != "convex_mesh"]


def grown_bounds(a: Geom, b: Geom, meshes: dict[str, Mesh], p: np.ndarray, q: np.ndarray) -> tuple:
    first, second = shape(a, meshes=meshes), shape(b, meshes=meshes)
    found = clearance_series([put(first, p, q)], [put(second, (0, 0, 0))], deep=True)
    return found.lower, found.upper


@pytest.mark.parametrize("kind", PRIMITIVES)
def test_growing_never_adds_clearance_and_scale_scales_it(kind: str) -> None:
    rng, meshes = np.random.default_rng(4), {}
    centred = {"position": (0, 0, 0), "orientation": (1, 0, 0, 0)}
    a, b = (any_geom(rng, k, meshes).model_copy(update=centred) for k in (kind, "cylinder"))
    p, q = rng.normal(size=(60, 3)) * 0.1, rng.normal(size=(60, 4))
    lower, upper = grown_bounds(a, b, meshes, p, q)
    for k in range(len(a.size)):
        size = tuple(s * 1.3 if i == k else s for i, s in enumerate(a.size))
        low, _ = grown_bounds(a.model_copy(update={"size": size}), b, meshes, p, q)
        assert (low <= upper + 1e-12).all()
    large = [g.model_copy(update={"size": tuple(4 * s for s in g.size)}) for g in (a, b)]
    low, high = grown_bounds(*large, meshes, 4 * p, q)
    assert (low <= 4 * upper + 1e-12).all()
    assert (4 * lower <= high + 1e-12).all()
