"""Batches: what is joined can be taken apart."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from simulate.clients.batch import join, kind, part, rows


def one(seed: int, n: int = 1) -> dict[str, Any]:
    random = np.random.default_rng(seed)
    return {
        "video": {"wrist": random.integers(0, 255, (n, 2, 3, 4, 3), np.uint8)},
        "state.joint_position": random.normal(size=(n, 1, 7)).astype(np.float32),
        "language": {"said": [[f"prompt {seed}.{i}"] for i in range(n)]},
    }


def same(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    return np.array_equal(a, b) if isinstance(a, np.ndarray) else bool(a == b)


def test_what_is_joined_can_be_taken_apart() -> None:
    sizes = (1, 3, 2)
    trees = [one(seed, n) for seed, n in enumerate(sizes)]
    assert len({kind(tree) for tree in trees}) == 1
    whole = join(trees)
    assert rows(whole) == sum(sizes)
    ends = np.cumsum((0, *sizes))
    for tree, begin, end in zip(trees, ends[:-1], ends[1:], strict=True):
        assert same(part(whole, int(begin), int(end)), tree)
        assert rows(tree) == end - begin


def test_what_cannot_be_joined_is_of_another_kind() -> None:
    other = one(0)
    other["video"]["wrist"] = other["video"]["wrist"][:, :1]
    more = one(0) | {"state.gripper": np.zeros((1, 1, 1), np.float32)}
    double = one(0) | {"state.joint_position": np.zeros((1, 1, 7))}
    assert len({kind(tree) for tree in (one(0), other, more, double)}) == 4


def test_rows_that_differ_are_told() -> None:
    with pytest.raises(ValueError, match=r"lengths \[1, 2\]"):
        rows(one(0) | {"said": ["a", "b"]})
    with pytest.raises(ValueError, match="lengths"):
        rows({})
