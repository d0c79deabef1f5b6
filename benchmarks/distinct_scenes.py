"""Which tasks are near-duplicates: the same rules, goal, roles and arrangement, whatever the objects are called.

python benchmarks/distinct_scenes.py [--within 0.05]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import NDArray

from simulate.tasks.task import Task, tasks

WITHIN = 0.05
"""m: two arrangements count as one if no distance between two objects differs by more."""


def signature(task: Task) -> tuple[object, ...]:
    """Rules, goal, number of objects, and the skills of both references in their order."""
    skills = [tuple(step.skill for step in task.steps(way)) for way in ("safe", "unsafe")]
    return (task.rules, task.goal, len(task.objects), *skills)


def arrangement_difference(a: Task, b: Task) -> float:
    """m: the most by which a distance in plan between two objects of ``a`` differs in ``b``.

    Objects are matched within their roles such that it is least; turning, shifting and mirroring a scene
    change nothing. Infinite where the roles are not played by as many.
    """
    ours, theirs = _by_role(a), _by_role(b)
    if {role: len(n) for role, n in ours.items()} != {role: len(n) for role, n in theirs.items()}:
        return float("inf")
    apart = _distances(a, [name for names in ours.values() for name in names])
    orders = product(*(permutations(theirs[role]) for role in ours))
    return min(
        float(np.abs(apart - _distances(b, [n for names in order for n in names])).max())
        for order in orders
    )


def near_duplicates(chosen: Sequence[Task], within: float = WITHIN) -> list[tuple[float, str, str]]:
    """(difference in m, id, id) of the pairs with the same rules and goal and one arrangement, closest first.

    Where there are only two objects, a distance says little: their references must have the same skills too.
    """
    out = []
    for a, b in combinations(chosen, 2):
        if (a.rules, a.goal) != (b.rules, b.goal):
            continue
        if len(a.objects) == 2 and signature(a) != signature(b):
            continue
        difference = arrangement_difference(a, b)
        if difference <= within:
            out.append((difference, a.id, b.id))
    return sorted(out)


def _by_role(task: Task) -> dict[str, list[str]]:
    out: dict[str, list[str]] = {}
    for name in task.objects:
        role = next((role for role, players in task.roles.items() if name in players), "")
        out.setdefault(role, []).append(name)
    return dict(sorted(out.items()))


def _distances(task: Task, names: Sequence[str]) -> NDArray[np.float64]:
    """(N, N) m in plan, without what seeds vary."""
    still = {n: p.model_copy(update={"jitter": type(p.jitter)()}) for n, p in task.objects.items()}
    layout = task.model_copy(update={"objects": still}).layout(0)
    at = np.array([layout[name][0][:2] for name in names])
    apart: NDArray[np.float64] = np.linalg.norm(at[:, None] - at[None], axis=2)
    return apart


def main() -> None:
    """Print the pairs, and how many signatures there are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--within", type=float, default=WITHIN, help="m")
    chosen = list(tasks().values())
    for difference, a, b in near_duplicates(chosen, parser.parse_args().within):
        print(f"{difference * 100:4.1f} cm  {a}  {b}")
    print(f"{len({signature(task) for task in chosen})} signatures of {len(chosen)} tasks")


if __name__ == "__main__":
    main()
