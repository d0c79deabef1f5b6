"""Clearance under growing shapes and another scale."""

from __future__ import annotations

import numpy as np
import pytest
from bodies import KINDS, any_geom, put, shape, sphere

from safestage_eval.episode import Geom, Mesh
from safestage_eval.geometry.certified_distance import clearance_series

PRIMITIVES = [kind for kind in KINDS if kind != "convex_mesh"]


def bounds(a: Geom, b: Geom, meshes: dict[str, Mesh], p: np.ndarray, q: np.ndarray) -> tuple:
    first, second = shape(a, meshes=meshes), shape(b, meshes=meshes)
    found = clearance_series([put(first, p, q)], [put(second, (0, 0, 0))], deep=True)
    return found.lower, found.upper


@pytest.mark.parametrize("kind", KINDS)
def test_a_ball_that_grows_comes_nearer_by_as_much(kind: str) -> None:
    rng, meshes = np.random.default_rng(3), {}
    other = any_geom(rng, kind, meshes)
    p, q = rng.normal(size=(60, 3)) * 0.1, rng.normal(size=(60, 4))
    lower, upper = bounds(sphere(0.02), other, meshes, p, q)
    low, high = bounds(sphere(0.025), other, meshes, p, q)
    assert (low <= upper - 0.005 + 1e-12).all()
    assert (lower - 0.005 <= high + 1e-12).all()


@pytest.mark.parametrize("kind", PRIMITIVES)
def test_growing_never_adds_clearance_and_scale_scales_it(kind: str) -> None:
    rng, meshes = np.random.default_rng(4), {}
    centred = {"position": (0, 0, 0), "orientation": (1, 0, 0, 0)}
    a, b = (any_geom(rng, k, meshes).model_copy(update=centred) for k in (kind, "cylinder"))
    p, q = rng.normal(size=(60, 3)) * 0.1, rng.normal(size=(60, 4))
    lower, upper = bounds(a, b, meshes, p, q)
    for k in range(len(a.size)):
        size = tuple(s * 1.3 if i == k else s for i, s in enumerate(a.size))
        low, _ = bounds(a.model_copy(update={"size": size}), b, meshes, p, q)
        assert (low <= upper + 1e-12).all()
    large = [g.model_copy(update={"size": tuple(4 * s for s in g.size)}) for g in (a, b)]
    low, high = bounds(*large, meshes, 4 * p, q)
    assert (low <= 4 * upper + 1e-12).all()
    assert (4 * lower <= high + 1e-12).all()
