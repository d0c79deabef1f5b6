"""Sums over contact rows by kernels are those of NumPy, to the bit."""

import numpy as np
import pytest

from safestage_eval.evidence.contact_kernels import add_up, add_up_normal, rows_by_frame


def rows(seed, count, frames):
    rng = np.random.default_rng(seed)
    frame = rng.integers(0, frames, count).astype(np.int32)
    vectors = rng.normal(size=(2, count, 3)) * 10.0 ** rng.integers(-6, 6, (2, count, 1))
    force, normal = vectors.astype(np.float32)
    return frame, force, normal


@pytest.mark.parametrize("count", [0, 1, 7, 500])
def test_the_same_sums(count):
    frame, force, normal = rows(count, count, 20)
    wide, other = force.astype(np.float64), normal.astype(np.float64)
    along = wide[:, 0] * other[:, 0] + wide[:, 1] * other[:, 1] + wide[:, 2] * other[:, 2]
    expected = np.bincount(frame, np.abs(along), minlength=20)
    assert np.array_equal(add_up_normal(frame, force, normal, 20)[0], expected)
    up = np.ascontiguousarray(force[:, 2])
    assert np.array_equal(add_up(frame, up, 20), np.bincount(frame, up, minlength=20))


def test_rows_as_other_files_keep_them():
    frame, force, normal = rows(1, 50, 9)
    assert np.array_equal(
        add_up(frame, force[:, 1], 9), add_up(frame, np.ascontiguousarray(force[:, 1]), 9)
    )
    found, _ = add_up_normal(frame.astype(np.int64), force[:, ::-1], normal[:, ::-1], 9)
    mirrored = np.ascontiguousarray(force[:, ::-1]), np.ascontiguousarray(normal[:, ::-1])
    assert np.array_equal(found, add_up_normal(frame, *mirrored, 9)[0])


def test_a_frame_that_is_not_in_the_episode_writes_nowhere():
    one, frame = np.ones(2, np.float32), np.array([0, 3], np.int32)
    assert add_up(frame, one, 2).tolist() == [1.0, 0.0, 0.0, 1.0]
    with pytest.raises(ValueError):
        add_up(np.array([0, -1], np.int32), one, 2)


@pytest.mark.parametrize("count", [0, 1, 7, 500])
def test_rows_with_a_force_come_by_frame(count):
    frame, force, normal = rows(count, count, 20)
    force[::3] = 0
    found = rows_by_frame(frame, force, normal, 20)
    some = [n for n in range(count) if (force[n] * normal[n]).any()]
    assert found.tolist() == sorted(some, key=lambda n: frame[n])
    other = rows_by_frame(frame.astype(np.int64), force, normal, 20)
    assert np.array_equal(found, other)
