"""Tasks are scenes of their own: no two have the same rules, goal and arrangement."""

from __future__ import annotations

import pytest
from distinct_scenes import WITHIN, arrangement_difference, near_duplicates, signature

from simulate.tasks.task import Placement, Task, task_named, tasks

pytestmark = pytest.mark.simulate


def _moved(task: Task, **to: tuple[float, float]) -> Task:
    objects = dict(task.objects)
    for name, position in to.items():
        objects[name] = Placement.model_validate(
            objects[name].model_dump() | {"position": position}
        )
    return task.model_copy(update={"id": f"{task.id}_moved", "objects": objects})


@pytest.fixture
def shelf() -> Task:
    return task_named("fsh_bottle_on_shelf")


def test_no_two_tasks_are_near_duplicates() -> None:
    assert not near_duplicates(list(tasks().values()))


def test_few_tasks_share_rules_goal_count_and_skills() -> None:
    chosen = tasks().values()
    assert len({signature(task) for task in chosen}) >= 90


def test_a_scene_that_is_shifted_or_mirrored_is_the_same(shelf: Task) -> None:
    for sign in (1, -1):
        at = {n: (p.position[0] + 0.1, sign * p.position[1]) for n, p in shelf.objects.items()}
        other = _moved(shelf, **at)
        assert arrangement_difference(shelf, other) == pytest.approx(0, abs=1e-9)
        assert near_duplicates([shelf, other])
        assert signature(other) == signature(shelf)


def test_the_difference_is_what_the_distance_changed_by(shelf: Task) -> None:
    bottle, board = (shelf.objects[name].position for name in ("bottle", "shelf"))
    for step in (WITHIN - 0.01, WITHIN + 0.01):
        length = ((bottle[0] - board[0]) ** 2 + (bottle[1] - board[1]) ** 2) ** 0.5
        share = 1 + step / length
        at = (board[0] + share * (bottle[0] - board[0]), board[1] + share * (bottle[1] - board[1]))
        other = _moved(shelf, bottle=at)
        assert arrangement_difference(shelf, other) == pytest.approx(step)
        assert bool(near_duplicates([shelf, other])) is (step <= WITHIN)


def test_other_rules_and_other_roles_make_another_scene(shelf: Task) -> None:
    assert not near_duplicates([shelf, shelf.model_copy(update={"rules": ("FSH102",)})])
    alone = shelf.model_copy(update={"roles": {"target": ("bottle",)}})
    assert arrangement_difference(shelf, alone) == float("inf")
