"""Several observations in one request, along the first axis of all that it holds."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np


def rows(tree: Any) -> int:
    """Number of rows in a map of arrays and lists. Raises ValueError where they differ."""
    counts = set(_lengths(tree))
    if len(counts) != 1:
        raise ValueError(f"arrays and lists of the lengths {sorted(counts)} in one batch")
    return counts.pop()


def kind(tree: Any) -> Hashable:
    """Equal for maps that ``join`` can make one of."""
    if isinstance(tree, dict):
        return tuple(sorted((str(key), kind(value)) for key, value in tree.items()))
    if isinstance(tree, np.ndarray) and tree.ndim:
        return tree.dtype.str, tree.shape[1:]
    return type(tree).__name__ if isinstance(tree, list) else repr(tree)


def join(trees: Sequence[Any]) -> Any:
    """One map with the rows of all, which are of one ``kind``."""
    first = trees[0]
    if isinstance(first, dict):
        return {key: join([tree[key] for tree in trees]) for key in first}
    if isinstance(first, np.ndarray) and first.ndim:
        return np.concatenate(trees)
    return [item for tree in trees for item in tree] if isinstance(first, list) else first


def part(tree: Any, first: int, last: int) -> Any:
    """The rows first … last − 1."""
    if isinstance(tree, dict):
        return {key: part(value, first, last) for key, value in tree.items()}
    there = isinstance(tree, list) or (isinstance(tree, np.ndarray) and tree.ndim > 0)
    return tree[first:last] if there else tree


def _lengths(tree: Any) -> list[int]:
    if isinstance(tree, dict):
        return [length for value in tree.values() for length in _lengths(value)]
    there = isinstance(tree, list) or (isinstance(tree, np.ndarray) and tree.ndim > 0)
    return [len(tree)] if there else []
