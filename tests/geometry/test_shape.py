"""Packing, motion blocks and the cache of machine code."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bodies import KINDS, any_geom, any_shape, box, put, shape, sphere, wanderer
from hypothesis import given, settings
from hypothesis import strategies as st

from safestage_eval._process import kernel_folder
from safestage_eval.episode import Geom, Mesh
from safestage_eval.geometry import pose
from safestage_eval.geometry.edge import edge_margin
from safestage_eval.geometry.mover import BLOCK, Mover
from safestage_eval.geometry.stillness import still_runs

few = settings(derandomize=True, deadline=None, max_examples=10)


@given(st.integers(0, 2**32 - 1))
@few
def test_ball_and_box_hold_the_body(seed: int) -> None:
    rng = np.random.default_rng(seed)
    body = any_shape(rng, 4)
    points = np.concatenate([p.vertices for p in body.polytopes if p is not None]) - body.centre
    assert np.linalg.norm(points, axis=1).max() <= body.radius + 1e-12
    assert (np.abs(points).max(0) <= body.half + 1e-12).all()
    meshes: dict[str, Mesh] = {}
    for kind in KINDS:
        solo = shape(any_geom(rng, kind, meshes), meshes=meshes)
        part = solo.polytopes[0]
        assert part is not None
        local = (part.vertices - solo.centre - solo.solids.offset[0]) @ solo.solids.rotation[0]
        assert np.linalg.norm(local, axis=1).max() <= solo.solids.radius[0] + 1e-12
        assert (np.abs(local).max(0) <= solo.solids.half[0] + 1e-12).all()


@given(st.integers(0, 2**32 - 1))
@few
def test_blocks_hold_the_body_and_paths_what_any_point_moves(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mover = wanderer(rng, 3 * BLOCK + 5, 0.3)
    motion = mover.motion
    vertices = np.concatenate([p.vertices for p in mover.shape.polytopes if p is not None])
    rotation = pose.matrix(mover.orientation)
    world = np.einsum("tij,vj->tvi", rotation, vertices) + mover.position[:, None]
    for k in range(len(motion.low)):
        rows = slice(k * BLOCK, (k + 1) * BLOCK)
        centre = motion.centre[rows]
        assert (centre >= motion.low[k]).all()
        assert (centre <= motion.high[k]).all()
        assert (np.abs(world[rows] - centre[:, None]) <= motion.extent[k] + 1e-12).all()
    for s, t in rng.integers(0, len(mover), (30, 2)):
        moved = np.linalg.norm(world[t] - world[s], axis=1).max()
        assert moved <= abs(motion.path[t] - motion.path[s]) + 1e-12


def test_a_resting_body_has_no_path() -> None:
    still = put(
        box(0.1, 0.1, 0.1),
        np.tile(np.float32([0.1, 0.2, 0.3]), (9, 1)),
        np.tile(np.float32([0.3, 0.2, 0.9, 0.1]), (9, 1)),
    )
    assert (still.motion.path == 0).all()


def test_the_same_geoms_are_packed_once() -> None:
    assert shape(sphere(0.1)) is shape(sphere(0.1))
    assert shape(sphere(0.1)) is not shape(sphere(0.2))
    assert shape(sphere(0.1)) is not shape(sphere(0.1), name="other")


def test_interior_points_of_a_convex_mesh_do_not_matter() -> None:
    rng = np.random.default_rng(0)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * 0.05
    mesh = Mesh.build(np.concatenate([corners, rng.uniform(-0.049, 0.049, (200, 3))]))
    body = shape(Geom(kind="convex_mesh", mesh=mesh.key), meshes={mesh.key: mesh})
    assert body.solids.points[0] == 8


def test_wrong_poses_are_refused() -> None:
    with pytest.raises(ValueError, match="have shapes"):
        put(sphere(0.1), (0, 0), (1, 0, 0, 0))
    with pytest.raises(ValueError, match="norm 0 or is not finite"):
        _ = put(sphere(0.1), (0, 0, 0), (0, 0, 0, 0)).motion
    with pytest.raises(KeyError):
        shape(Geom(kind="mesh", mesh="nowhere"))


def test_runs_end_where_something_moved() -> None:
    p = np.zeros((8, 3))
    p[3:, 0], p[6:, 0] = 1e-3, 1e-3 + 1e-6
    mover = put(sphere(0.1), p, np.tile([1.0, 0, 0, 0], (8, 1)))
    asked = np.array([1, 2, 7])

    def runs(body: Mover, frames: np.ndarray) -> list[tuple[int, list[int]]]:
        return [(at, alike.tolist()) for at, alike in still_runs((body,), frames)]

    assert runs(mover, np.arange(8)) == [(0, [0, 1, 2]), (3, [3, 4, 5, 6, 7])]
    assert runs(mover, asked) == [(0, [1, 2]), (3, [7])], "whoever asks, a run begins where it does"
    assert runs(put(sphere(0.1), (0, 0, 0)), np.arange(4)) == [(0, [0, 1, 2, 3])]


def test_later_frames_of_what_never_moves_may_be_asked_for() -> None:
    block, table = put(box(0.02, 0.02, 0.02), (0, 0, 0.02)), put(box(0.1, 0.1, 0.1), (0, 0, -0.1))
    found = edge_margin(block, [table], np.array([5, 7]))
    np.testing.assert_allclose(found[[5, 7]], 0.08, atol=1e-9)


def test_machine_code_is_kept_by_the_content_of_the_sources(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    room = Path(pose.__file__).parent
    before = kernel_folder.cache_folder(room)
    assert before is not None
    assert before.name.startswith("kernels-")
    may = kernel_folder.os.access
    monkeypatch.setattr(
        kernel_folder.os, "access", lambda path, mode: path != room and may(path, mode)
    )
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "somewhere"))
    kernel_folder.cache_folder.cache_clear()
    try:
        assert (
            str(kernel_folder.cache_folder(room)) == f"{tmp_path}/somewhere/safestage/{before.name}"
        )
    finally:
        kernel_folder.cache_folder.cache_clear()
