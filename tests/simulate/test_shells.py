"""Meshes of skins: closed where they are to be, facing outwards, with the volumes of their shapes."""

from __future__ import annotations

import numpy as np
import pytest

from simulate.looks.shells import Shell, capsule, ellipsoid, revolved, rounded_box

pytestmark = pytest.mark.simulate


def volume(shell: Shell) -> float:
    """m³ by the divergence theorem; positive only where faces are turned outwards."""
    a, b, c = (shell.vertices[shell.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


CASES = {
    "cylinder": (
        revolved([(0, -0.06), (0.035, -0.06), (0.035, 0.06), (0, 0.06)]),
        np.pi * 0.035**2 * 0.12,
    ),
    "ball": (ellipsoid((0.03, 0.03, 0.03)), 4 / 3 * np.pi * 0.03**3),
    "egg": (ellipsoid((0.02, 0.03, 0.04)), 4 / 3 * np.pi * 0.02 * 0.03 * 0.04),
    "capsule": (
        capsule(0.02, 0.05),
        np.pi * 0.02**2 * 0.1 + 4 / 3 * np.pi * 0.02**3,
    ),
    "box": (rounded_box((0.1, 0.05, 0.02), 1e-6), 8 * 0.1 * 0.05 * 0.02),
}


@pytest.mark.parametrize("name", CASES)
def test_a_shell_has_the_volume_of_its_shape(name: str) -> None:
    shell, exact = CASES[name]
    assert volume(shell) == pytest.approx(exact, rel=0.02)


@pytest.mark.parametrize("name", CASES)
def test_every_edge_has_two_sides(name: str) -> None:
    """Where vertices at one place count as one, each edge is passed once either way: closed."""
    shell, _ = CASES[name]
    _, same = np.unique(np.round(shell.vertices, 9), axis=0, return_inverse=True)
    faces = same.reshape(-1)[shell.faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    edges = np.concatenate([faces[:, [i, (i + 1) % 3]] for i in range(3)])
    there = {(int(a), int(b)) for a, b in edges}
    assert len(there) == len(edges)
    assert all((b, a) in there for a, b in there)


@pytest.mark.parametrize("name", CASES)
def test_normals_are_unit_vectors_on_their_faces_outer_side(name: str) -> None:
    shell, _ = CASES[name]
    assert np.allclose(np.linalg.norm(shell.normals, axis=1), 1)
    a, b, c = (shell.vertices[shell.faces[:, i]] for i in range(3))
    flat = np.cross(b - a, c - a)
    for i in range(3):
        along = np.einsum("ij,ij->i", flat, shell.normals[shell.faces[:, i]])
        assert (along >= -1e-12).all()
    assert shell.uv.min() >= 0
    assert shell.uv.max() <= 1 + 1e-12


def test_a_moved_shell_keeps_its_form() -> None:
    shell, exact = CASES["egg"]
    quarter = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))  # about z: x becomes y
    moved = shell.moved((1.0, 2.0, 3.0), quarter)
    assert volume(moved) == pytest.approx(volume(shell)) == pytest.approx(exact, rel=0.02)
    assert np.allclose(moved.vertices[:, 1] - 2, shell.vertices[:, 0])
    assert np.allclose(moved.vertices[:, 2] - 3, shell.vertices[:, 2])
