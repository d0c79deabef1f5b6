"""Lengths and distances against NumPy's, of either precision."""

from __future__ import annotations

import numpy as np
import pytest

from safestage_eval.geometry.lengths import distances, lengths
from safestage_eval.geometry.pose import angle, rotate, transform


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_lengths_are_those_of_numpy(dtype: type) -> None:
    v = np.random.default_rng(0).normal(size=(50, 3)).astype(dtype)
    wide = v.astype(np.float64)
    np.testing.assert_allclose(lengths(v), np.linalg.norm(wide, axis=1), rtol=1e-15)
    np.testing.assert_allclose(lengths(v, 2), np.linalg.norm(wide[:, :2], axis=1), rtol=1e-15)
    np.testing.assert_allclose(lengths(v[:, ::-1]), lengths(v), rtol=1e-15)
    from_first = np.linalg.norm(wide - wide[0], axis=1)
    np.testing.assert_allclose(distances(v, v[:1]), from_first, rtol=1e-15)
    np.testing.assert_allclose(distances(v, np.broadcast_to(v[0], v.shape)), from_first)
    assert (distances(v, v) == 0).all()


def test_stored_precision_changes_no_turn() -> None:
    rng = np.random.default_rng(1)
    q, p = (rng.normal(size=(40, k)).astype(np.float32) for k in (4, 3))
    wide, point = q.astype(np.float64), np.array([0.1, 0.2, -0.3])
    assert (rotate(q, point) == rotate(wide, point)).all()
    assert (transform(p, q, point) == rotate(wide, point) + p.astype(np.float64)).all()
    assert (angle(q, q[0]) == angle(wide, wide[0])).all()
    q.flags.writeable = False
    assert (angle(q, wide[0]) == angle(wide, wide[0])).all()
