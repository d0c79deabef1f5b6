"""Penetration depth: analytic truths, an independent oracle, laws."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import KINDS, any_geom, box, cylinder, put, shape, sphere
from sampled import share, tries
from scipy.optimize import minimize

from safestage_eval.episode import Geom, Mesh
from safestage_eval.geometry import pose
from safestage_eval.geometry.group_clearance import clearance_series
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.penetration import DEPTH_TOLERANCE

CUBE = box(0.05, 0.05, 0.05)
EGG = Geom(kind="ellipsoid", size=(0.02, 0.03, 0.05))
BALL = Geom(kind="ellipsoid", size=(0.03, 0.03, 0.03))
CAN = cylinder(0.03, 0.05)
ROD = Geom(kind="capsule", size=(0.02, 0.1))
LYING = (np.cos(np.pi / 4), np.sin(np.pi / 4), 0.0, 0.0)

TRUTHS = [
    ("cylinders side by side", put(CAN, (0, 0, 0)), put(CAN, (0.05, 0, 0)), 0.01),
    ("cylinders stacked, 1 µm deep", put(CAN, (0, 0, 0)), put(CAN, (0.01, 0, 0.1 - 1e-6)), 1e-6),
    ("cylinders crossed", put(CAN, (0, 0, 0)), put(CAN, (0, 0, 0.07), LYING), 0.01),
    ("cylinder in a box's floor", put(CAN, (0, 0, 0.04)), put(box(1, 1, 0.02), (0, 0, 0)), 0.03),
    ("ellipsoid in a box", put(EGG, (0, 0, 0.09)), put(CUBE, (0, 0, 0)), 0.01),
    ("ellipsoids end to end", put(EGG, (0, 0, 0)), put(EGG, (0, 0, 0.099)), 0.001),
    ("round ellipsoids", put(BALL, (0, 0, 0)), put(BALL, (0.03, 0.04, 0)), 0.01),
    ("sphere within a cylinder", put(sphere(0.01), (0.02, 0, 0)), put(CAN, (0, 0, 0)), 0.02),
    ("sphere in the middle of a cylinder", put(sphere(0.01), (0, 0, 0)), put(CAN, (0, 0, 0)), 0.04),
    ("capsule across a cylinder", put(ROD, (0, 0, 0.06), LYING), put(CAN, (0, 0, 0)), 0.01),
    ("box edge in a cylinder's rim", put(CAN, (0.04, 0, 0)), put(CUBE, (-0.03, 0, 0.2)), -0.1),
    ("thin plate through a cylinder", put(CAN, (0, 0, 0)), put(box(1, 1, 1e-6), (0, 0, 0)), 0.050001),
    ("needles crossed", put(cylinder(1e-4, 1), (0, 0, 0)), put(cylinder(1e-4, 1), (0, 0, 0), LYING), 2e-4),
]  # fmt: skip


def depth(a: Mover, b: Mover, **options: object) -> tuple[float, float]:
    found = clearance_series([a], [b], deep=True, **options)
    return -float(found.upper[0]), -float(found.lower[0])


@pytest.mark.parametrize(("a", "b", "truth"), [t[1:] for t in TRUTHS], ids=[t[0] for t in TRUTHS])
def test_truth(a: Mover, b: Mover, truth: float) -> None:
    for lower, upper in (depth(a, b), depth(b, a)):
        assert lower - 1e-12 <= truth <= upper + 1e-12
        assert upper - lower <= 2 * DEPTH_TOLERANCE


def reach(geom: Geom, meshes: dict[str, Mesh], direction: np.ndarray) -> np.ndarray:
    """(N,) m how far a geom at the origin reaches along unit directions (N, 3); not our support."""
    x, y, z = direction.T
    s = geom.size
    if geom.kind == "sphere":
        return np.full(len(direction), s[0])
    if geom.kind == "capsule":
        return s[0] + s[1] * np.abs(z)
    if geom.kind == "box":
        return np.abs(direction) @ np.array(s)
    if geom.kind == "cylinder":
        return s[0] * np.hypot(x, y) + s[1] * np.abs(z)
    if geom.kind == "ellipsoid":
        return np.sqrt((direction**2) @ np.array(s) ** 2)
    return (direction @ meshes[str(geom.mesh)].vertices.astype(np.float64).T).max(1)


@pytest.mark.parametrize("first", share(KINDS, 3))
def test_no_direction_parts_them_sooner(first: str) -> None:
    """The depth is the least overlap over directions: 4,000 of them, the best ones refined."""
    rng = np.random.default_rng(KINDS.index(first))
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    centred = {"position": (0, 0, 0), "orientation": (1, 0, 0, 0)}
    seen = 0
    for second in KINDS:
        meshes: dict[str, Mesh] = {}
        a, b = (any_geom(rng, kind, meshes).model_copy(update=centred) for kind in (first, second))
        for _ in range(tries(2, 4)):
            q, r, p = rng.normal(size=4), rng.normal(size=4), rng.normal(size=3) * 0.02
            lower, upper = depth(
                put(shape(a, meshes=meshes), (0, 0, 0), q), put(shape(b, meshes=meshes), p, r)
            )
            if upper <= 0:
                continue
            Ra, Rb = pose.matrix(q), pose.matrix(r)

            def overlap(d: np.ndarray) -> np.ndarray:
                d = np.atleast_2d(d) / np.linalg.norm(np.atleast_2d(d), axis=1, keepdims=True)
                return reach(a, meshes, d @ Ra) + reach(b, meshes, -d @ Rb) - d @ p  # noqa: B023

            sampled = overlap(directions)
            assert sampled.min() >= lower - 1e-12
            best = [
                minimize(lambda d: overlap(d)[0], directions[i], method="Nelder-Mead",
                         options={"xatol": 1e-8, "fatol": 1e-12, "maxfev": 400}).fun
                for i in np.argsort(sampled)[:40:4]
            ]  # fmt: skip
            assert lower - 1e-12 <= min(best) <= upper + 1e-6
            seen += 1
    assert seen >= tries(3, 6)


def test_depth_changes_by_no_more_than_the_move() -> None:
    rng = np.random.default_rng(5)
    meshes: dict[str, Mesh] = {}
    for first in KINDS:
        a, b = any_geom(rng, first, meshes), any_geom(rng, "convex_mesh", meshes)
        steps = np.cumsum(rng.normal(size=(100, 3)) * 0.002, 0)
        turn = np.tile([1.0, 0, 0, 0], (100, 1))
        found = clearance_series(
            [put(shape(a, meshes=meshes), steps, turn)],
            [put(shape(b, meshes=meshes), (0, 0, 0))],
            deep=True,
        )
        move = np.linalg.norm(np.diff(steps, axis=0), axis=1)
        assert (found.lower[1:] - found.upper[:-1] <= move + 1e-12).all()
        assert (found.lower[:-1] - found.upper[1:] <= move + 1e-12).all()
