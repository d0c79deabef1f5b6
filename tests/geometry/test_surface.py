"""Nonconvex meshes: distances, insides, and a mesh within a mesh."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from bodies import box, put, shape, sphere

from safestage_eval.episode import Geom, Mesh
from safestage_eval.geometry.group_clearance import clearance_series
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.shape import BodyShape


def mesh_body(source: trimesh.Trimesh, kind: str = "mesh") -> BodyShape:
    mesh = Mesh.build(source.vertices, source.faces)
    return shape(Geom(kind=kind, mesh=mesh.key), meshes={mesh.key: mesh})


def cup() -> BodyShape:
    """A box without a lid, of five overlapping slabs: 20 cm wide, walls and floor 1 cm thick."""
    slabs = [((0.2, 0.2, 0.01), (0, 0, -0.095))]
    for sign in (-1, 1):
        slabs.append(((0.01, 0.2, 0.2), (sign * 0.095, 0, 0)))
        slabs.append(((0.2, 0.01, 0.2), (0, sign * 0.095, 0)))
    parts = []
    for size, at in slabs:
        part = trimesh.creation.box(size)
        part.apply_translation(at)
        parts.append(part)
    return mesh_body(trimesh.util.concatenate(parts))


CUBE = mesh_body(trimesh.creation.box((0.1, 0.1, 0.1)))


def between(a: Mover, b: Mover, cap: float = np.inf) -> tuple[float, float]:
    found = clearance_series([a], [b], cap)
    return float(found.lower[0]), float(found.upper[0])


@pytest.mark.parametrize("other", [CUBE, shape(box(0.05, 0.05, 0.05))], ids=["mesh", "box"])
def test_apart_is_exact(other: BodyShape) -> None:
    for at, truth in (((0.3, 0, 0), 0.2), ((0.13, 0.14, 0), 0.05), ((0.11, 0.12, 0.12), 0.03)):
        for pair in (
            (put(CUBE, (0, 0, 0)), put(other, at)),
            (put(other, at), put(CUBE, (0, 0, 0))),
        ):
            lower, upper = between(*pair)
            assert lower - 1e-8 <= truth <= upper + 1e-8  # float32 vertices
            assert upper - lower <= 1e-9


@pytest.mark.parametrize(
    "small",
    [
        mesh_body(trimesh.creation.icosphere(radius=0.01)),
        shape(sphere(0.01)),
        shape(box(0.01, 0.01, 0.01)),
    ],
    ids=["mesh", "sphere", "box"],
)
def test_within_a_solid_mesh_is_penetration_not_a_gap(small: BodyShape) -> None:
    for pair in (
        (put(CUBE, (0, 0, 0)), put(small, (0.01, 0, 0))),
        (put(small, (0.01, 0, 0)), put(CUBE, (0, 0, 0))),
    ):
        lower, upper = between(*pair)
        assert upper <= 0
        assert lower <= -0.05  # to leave, it must move by 4 cm and its own size


def test_inside_a_cup_is_a_gap() -> None:
    """Nonconvex for good: the ball hangs in the cup and touches nothing."""
    lower, upper = between(put(cup(), (0, 0, 0)), put(sphere(0.03), (0.02, 0, 0)))
    assert lower - 1e-8 <= 0.09 - 0.02 - 0.03 <= upper + 1e-8
    lower, upper = between(put(cup(), (0, 0, 0)), put(CUBE, (0.02, 0, 0)))
    assert lower - 1e-8 <= 0.09 - 0.02 - 0.05 <= upper + 1e-8


def test_pruned_over_time_is_what_each_frame_says() -> None:
    rng = np.random.default_rng(3)
    frames = 150
    a = trimesh.creation.torus(0.06, 0.02, major_sections=16, minor_sections=8)
    p = np.cumsum(rng.normal(size=(frames, 3)) * 0.01, 0) + np.array([0.15, 0, 0])
    q = np.cumsum(rng.normal(size=(frames, 4)) * 0.05, 0) + np.array([1, 0, 0, 0])
    p[50:80], q[50:80] = p[50], q[50]
    moving = put(mesh_body(a), p.astype(np.float32), q.astype(np.float32))
    for other in (CUBE, shape(Geom(kind="cylinder", size=(0.02, 0.1)))):
        still = put(other, (0, 0, 0))
        alone = [between(moving.at(np.array([t])), still) for t in range(frames)]
        for cap in (np.inf, 0.1):
            found = clearance_series([moving], [still], cap)
            for t, (lower, upper) in enumerate(alone):
                if lower > cap:
                    assert (found.lower[t], found.upper[t]) == (cap, np.inf)
                else:
                    assert found.lower[t] == pytest.approx(lower, abs=2e-9)
                    assert found.upper[t] == pytest.approx(upper, abs=2e-9)
