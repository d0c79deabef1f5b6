"""Clearance: analytic truths, agreement with independent solvers, laws, and exact pruning."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from bodies import KINDS, any_geom, any_shape, box, cylinder, put, shape, sphere, wanderer
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval.episode import Geom, Mesh
from safestage_eval.geometry import gjk, pose
from safestage_eval.geometry.group_clearance import (
    Clearance,
    clearance_pairs,
    clearance_series,
    motion_bound,
)
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.support_function import Pair

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
    R, p, out, up = np.empty((3, 3)), np.empty(3), np.empty(2), np.zeros(3)
    work = gjk.scratch()
    for first in a:
        for second in b:
            A, B = first.shape.solids, second.shape.solids
            for t in range(frames):
                i, j = min(t, len(first) - 1), min(t, len(second) - 1)
                RA, RB = pose.matrix(first.orientation[i]), pose.matrix(second.orientation[j])
                gap = second.motion.centre[j] - first.motion.centre[i]
                for g in range(len(A.kind)):
                    for h in range(len(B.kind)):
                        pair = Pair(A, g, B, h, R, p, up)
                        gjk.relative_pose(pair, RA, RB, gap, work)
                        at = np.zeros((4, 3)), np.zeros((4, 3))
                        gjk.geom_distance(pair, *at, 0, np.inf, False, work, out)
                        lower[t], upper[t] = min(lower[t], out[0]), min(upper[t], out[1])
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


@pytest.mark.parametrize("side", [-np.inf, np.inf])
def test_one_ulp_from_touching(side: float) -> None:
    for geom in (CUBE, cylinder(0.05, 0.05), sphere(0.05)):
        lower, upper = between(put(geom, (0, 0, 0)), put(geom, (np.nextafter(0.1, side), 0, 0)))
        assert abs(lower) <= 1e-9
        assert abs(upper) <= 1e-9


def test_meeting_cores_are_bounded_from_below() -> None:
    """Cylinders overlapping by 1 cm sideways: at most 0, at least minus the depth."""
    lower, upper = between(
        put(cylinder(0.03, 0.05), (0, 0, 0)), put(cylinder(0.05, 0.15), (0.07, 0, 0))
    )
    assert lower == pytest.approx(-0.01, abs=1e-12)
    assert upper == 0.0


def test_bodies_without_geoms_do_not_count() -> None:
    found = clearance_series([put(shape(), (0, 0, 0))], [put(CUBE, (0, 0, 0))], 0.1)
    assert (found.lower[0], found.upper[0]) == (0.1, np.inf)


def test_a_body_is_not_measured_against_itself() -> None:
    cube, other = put(CUBE, (0, 0, 0)), put(CUBE, (0.3, 0, 0))
    assert between(cube, cube)[1] == np.inf
    assert clearance_series([cube, other], [cube]).upper[0] == pytest.approx(0.2)
    chosen = clearance_pairs([(cube, other)], 1, 0.1)
    assert (chosen.lower[0], chosen.upper[0]) == (0.1, np.inf)


def test_lengths_that_contradict_are_refused() -> None:
    with pytest.raises(ValueError, match="different lengths"):
        clearance_series(
            [put(CUBE, np.zeros((3, 3)), np.tile([1, 0, 0, 0], (3, 1)))],
            [put(CUBE, np.zeros((4, 3)), np.tile([1, 0, 0, 0], (4, 1)))],
        )


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
    frames = int(rng.integers(1, 300))
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


def test_a_still_pair_is_tight_again_when_a_nearer_one_leaves() -> None:
    """The nearer pair loosens what is known of the farther one; that must not be kept."""
    frames = 200
    still = put(shape(EGG, cylinder(0.02, 0.03)), (0.09, 0.01, 0.03), (0.9, 0.2, 0.3, 0.1))
    x = np.where(np.arange(frames) < 100, -0.11, -5.0)
    poses = np.stack([x, 0 * x, 0 * x], 1)
    leaving = put(CUBE, poses, np.tile([1.0, 0, 0, 0], (frames, 1)))
    found = clearance_series([leaving, still], [put(CUBE, (0, 0, 0))], 1.0)
    truth = plain([leaving, still], [put(CUBE, (0, 0, 0))])
    assert np.abs(found.upper - truth.upper).max() <= 1e-9
    assert (found.upper - found.lower).max() <= 1e-9


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


def test_float32_poses_are_read_as_they_are() -> None:
    """0.3 in float32 is 0.30000001: the answer is that, in float64, not rounded on the way."""
    at = np.float32([0, 0.3, 0])
    lower, upper = between(put(CUBE, np.float32([0, 0, 0])), put(CUBE, at))
    assert lower - 1e-12 <= float(at[1]) - 0.1 <= upper + 1e-12


def test_agrees_with_coal() -> None:
    """A few thousand random pairs against coal's own solvers, to 1e-6 m."""
    coal = pytest.importorskip("coal")

    def foreign(geom: Geom, meshes: dict[str, Mesh]) -> object:
        size = geom.size
        if geom.kind == "convex_mesh":
            points = coal.StdVec_Vec3s()
            for vertex in meshes[str(geom.mesh)].vertices.astype(np.float64):
                points.append(vertex)
            return coal.Convex.convexHull(points, False, "")
        return {
            "sphere": lambda: coal.Sphere(size[0]),
            "capsule": lambda: coal.Capsule(size[0], 2 * size[1]),
            "cylinder": lambda: coal.Cylinder(size[0], 2 * size[1]),
            "box": lambda: coal.Box(*(2 * s for s in size)),
            "ellipsoid": lambda: coal.Ellipsoid(*size),
        }[geom.kind]()

    rng, n, compared = np.random.default_rng(7), 120, 0
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
            ca, cb = foreign(ga, meshes), foreign(gb, meshes)
            request, result = coal.DistanceRequest(), coal.DistanceResult()
            request.gjk_tolerance = 1e-8  # its own 1e-6 may be exceeded by a tenth
            for t in np.flatnonzero(found.lower > 1e-4):
                result.clear()
                there = coal.distance(
                    ca,
                    coal.Transform3s(pose.matrix(qa[t]), np.zeros(3)),
                    cb,
                    coal.Transform3s(pose.matrix(qb[t]), pb[t]),
                    request,
                    result,
                )
                assert found.lower[t] - 1e-6 <= there <= found.upper[t] + 1e-6, (ga, gb)
                compared += 1
    assert compared > 1000


PRIMITIVES = [kind for kind in KINDS if kind != "convex_mesh"]


def grown_bounds(a: Geom, b: Geom, meshes: dict[str, Mesh], p: np.ndarray, q: np.ndarray) -> tuple:
    first, second = shape(a, meshes=meshes), shape(b, meshes=meshes)
    found = clearance_series([put(first, p, q)], [put(second, (0, 0, 0))], deep=True)
    return found.lower, found.upper


@pytest.mark.parametrize("kind", KINDS)
def test_a_ball_that_grows_comes_nearer_by_as_much(kind: str) -> None:
    rng, meshes = np.random.default_rng(3), {}
    other = any_geom(rng, kind, meshes)
    p, q = rng.normal(size=(60, 3)) * 0.1, rng.normal(size=(60, 4))
    lower, upper = grown_bounds(sphere(0.02), other, meshes, p, q)
    low, high = grown_bounds(sphere(0.025), other, meshes, p, q)
    assert (low <= upper - 0.005 + 1e-12).all()
    assert (lower - 0.005 <= high + 1e-12).all()


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
