"""Strange values in the place of plain ones, in whatever nests lists and tables."""

from __future__ import annotations

import copy
from random import Random
from typing import Any

NAMES = (
    "", "nobody", "../../etc/passwd", "/etc/passwd", "..", "C:\\x", "a\0b", "é" * 300, "x" * 5000,
    "\ud800", "<script>alert(1)</script>", "a\nb", "%s%n{0}{x}", "\u202e", "table", "cube", "~", ".",
)  # fmt: skip
NUMBERS = (
    0, -1, 1, 2, 0.5, -0.0, 1e-320, 1e-30, 1e30, 1e308, 2**31, 2**63, 10**30, -(2**63), float("nan"),
    float("inf"), -float("inf"),
)  # fmt: skip
OTHERS: tuple[Any, ...] = (
    None, True, False, [], {}, [[]], [{}], {"": 1}, [0, 0, 0], [0, 0, 0, 0], [1e30] * 3, ["x"],
    "1 cm", ">= 2 cm",
)  # fmt: skip


def strange(rng: Random, like: Any = None) -> Any:
    """A value that is hardly ever right; of the same kind half of the time."""
    if rng.random() < 0.5 and like is not None:
        if isinstance(like, str):
            return rng.choice(NAMES)
        if isinstance(like, int | float) and not isinstance(like, bool):
            return rng.choice(NUMBERS)
        if isinstance(like, list) and like:
            many = (
                8 if isinstance(like[0], dict) else 50
            )  # shapes by the hundred take long, no more
            return rng.choice((like * 2, like[:-1], like[::-1], [like], like * many))
        if isinstance(like, dict) and like:
            return {key: like[key] for key in list(like)[1:]}
    return copy.deepcopy(rng.choice((*NAMES, *NUMBERS, *OTHERS)))


def places(node: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths of all values in it."""
    found = [path] if path else []
    entries = (
        node.items()
        if isinstance(node, dict)
        else enumerate(node)
        if isinstance(node, list)
        else ()
    )
    for key, value in entries:
        found += places(value, (*path, key))
    return found


def altered(rng: Random, tree: Any) -> tuple[Any, str]:
    """A copy with one value replaced, removed, moved or renamed, and what was done."""
    tree = copy.deepcopy(tree)
    where = places(tree)
    if not where:
        return strange(rng), "another value"
    path = rng.choice(where)
    owner = tree
    for key in path[:-1]:
        owner = owner[key]
    key, place = path[-1], ".".join(map(str, path))
    act = rng.random()
    if act < 0.12 and isinstance(owner, dict):
        del owner[key]
        return tree, f"{place} gone"
    if act < 0.2 and isinstance(owner, list):
        owner.append(copy.deepcopy(owner[key]))
        return tree, f"{place} twice"
    if act < 0.26 and isinstance(owner, dict):
        owner[rng.choice(NAMES)] = owner.pop(key)
        return tree, f"{place} renamed"
    if act < 0.34:
        other = rng.choice(where)
        value = tree
        for part in other:
            value = value[part]
        owner[key] = copy.deepcopy(value)
        return tree, f"{place} = {'.'.join(map(str, other))}"
    owner[key] = strange(rng, owner[key])
    return tree, f"{place} = {str(owner[key])[:40]!r}"
