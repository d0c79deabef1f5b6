"""Strange values in the place of plain ones, in whatever nests tables, lists, arrays and bytes."""

from __future__ import annotations

import copy
from random import Random
from typing import Any

import numpy as np
from damage import damaged

NAMES = (
    "", "nobody", "../../etc/passwd", "/etc/passwd", "/dev/zero", "..", "C:\\x", "a\0b", "é" * 300,
    "x" * 5000, "\ud800", "<script>alert(1)</script>", "a\nb", "%s%n{0}{x}", "\u202e", "table",
    "cube", "map", "~", ".",
)  # fmt: skip
NUMBERS = (
    0, -1, 1, 2, 0.5, -0.0, 1e-320, 1e-30, 1e30, 1e308, 2**31, 2**63, 10**30, -(2**63), float("nan"),
    float("inf"), -float("inf"),
)  # fmt: skip
OTHERS: tuple[Any, ...] = (
    None, True, False, [], {}, [[]], [{}], {"": 1}, [0, 0, 0], [0, 0, 0, 0], [1e30] * 3, ["x"],
    "1 cm", ">= 2 cm",
)  # fmt: skip
KINDS = ("f2", "f4", "f8", "i4", "i8", "u1", "bool", "c8", "U8", "S3", "M8[s]")


class Table(dict[str, Any]):
    """Columns of one length; ``types`` are those that they had."""

    types: dict[str, Any]


def altered(rng: Random, tree: Any) -> tuple[Any, str]:
    """The tree with one thing replaced, removed, moved or renamed in place, and what was done."""
    if not _keys(tree):
        return strange(rng, tree), "another value"
    node, path = tree, list[Any]()
    while True:
        keys = _keys(node)
        path.append(rng.choice(keys))
        child = node[path[-1]]
        if not _keys(child) or rng.random() < 0.15:
            break
        node = child
    key, place, act = path[-1], ".".join(str(part)[:40] for part in path), rng.random()
    if isinstance(node, Table) and act < 0.4:
        return tree, f"{place} {_rows(rng, node)}"
    if act < 0.15:
        del node[key]
        return tree, f"{place} gone"
    if act < 0.3 and isinstance(node, list):
        what, other = rng.choice(("twice", "exchanged", "cut")), rng.randrange(len(node))
        if what == "cut":
            del node[key:]
        elif what == "twice":
            node.insert(other, copy.deepcopy(child))
        else:
            node[key], node[other] = node[other], node[key]
        return tree, f"{place} {what}"
    if act < 0.25:
        node[rng.choice(NAMES)] = node.pop(key)
        return tree, f"{place} renamed"
    if act < 0.35:
        other = rng.choice(keys)
        node[key] = copy.deepcopy(node[other])
        return tree, f"{place} = {str(other)[:40]}"
    node[key] = strange(rng, child)
    return tree, f"{place} = {str(node[key])[:40]!r}"


def _keys(node: Any) -> list[Any]:
    if isinstance(node, dict):
        return list(node)
    return list(range(len(node))) if isinstance(node, list) else []


def strange(rng: Random, like: Any = None) -> Any:
    """A value that is hardly ever right; most of the time of the same kind."""
    if isinstance(like, np.ndarray) and like.size:
        return _array(rng, like)
    if isinstance(like, bytes) and rng.random() < 0.9:
        return damaged(rng, like)[0]
    if rng.random() < 0.5 and like is not None:
        if isinstance(like, str):
            return rng.choice(NAMES)
        if isinstance(like, int | float) and not isinstance(like, bool):
            return rng.choice(NUMBERS)
        if isinstance(like, list) and like:  # tables by the hundred take long, no more
            many = 8 if isinstance(like[0], dict) else 50
            return rng.choice((like * 2, like[:-1], like[::-1], [like], like * many))
        if isinstance(like, dict) and like:
            return {key: like[key] for key in list(like)[1:]}
    return copy.deepcopy(rng.choice((*NAMES, *NUMBERS, *OTHERS)))


def _array(rng: Random, values: np.ndarray) -> np.ndarray:
    """Other numbers in one place or in a stretch, or an array of another size or kind."""
    act = rng.choice(("number", "number", "stretch", "stretch", "size", "kind"))
    with np.errstate(all="ignore"):
        if act == "kind" and not values.dtype.names:
            return np.nan_to_num(values).astype(rng.choice(KINDS))
        if act == "size":
            rows = len(values) if values.ndim else 1
            most = 10**5 * rows // values.size
            size = rng.choice((0, 1, rows - 1, rows + 1, 2 * rows, most))
            return np.resize(values, (size, *values.shape[1:]))
        new = np.ascontiguousarray(values).copy()
        flat = new.reshape(-1).view(np.float32 if new.dtype.names else new.dtype)
        first = rng.randrange(len(flat))
        last = first + 1 + int(rng.random() ** 3 * len(flat)) if act == "stretch" else first + 1
        number = np.array(rng.choice((*NUMBERS, *[np.nan] * 12, *[rng.gauss(0, 1)] * 6)), "f8")
        flat[first:last] = number.astype(flat.dtype)
        return new


def _rows(rng: Random, table: Table) -> str:
    """Rows gone, twice, cut off, in another order, or very many."""
    many = len(next(iter(table.values())))
    act = rng.choice(("gone", "twice", "cut", "exchanged", "many"))
    at, other = (rng.randrange(max(many, 1)) for _ in range(2))
    rows = {
        "gone": [i for i in range(many) if i != at],
        "twice": [*range(many), *range(min(at, many), min(at + 1, many))],
        "cut": list(range(at)),
        "exchanged": [{at: other, other: at}.get(i, i) for i in range(many)],
        "many": [*range(many)] * rng.choice((2, 10)),
    }[act]
    for name, column in table.items():
        table[name] = column[rows] if isinstance(column, np.ndarray) else [column[i] for i in rows]
    return f"row {at} {act}"
