"""Slots: order by what prompts name, one orientation one row, empty slots told apart."""

from __future__ import annotations

import numpy as np
import pytest

from safestage_eval.errors import InputError
from simulate.learn.scene_slots import SLOT, SLOT_NAMES, SLOTS, filled, slot_order
from simulate.tasks.task import tasks

POSE = np.array([0.1, 0.2, 0.3, 0.6, 0.0, 0.8, 0.0])


def test_targets_and_destinations_come_first_and_other_roles_are_not_told() -> None:
    names = ["a", "b", "c", "d"]
    roles = {"destination": ("d",), "protected": ("b",), "target": ("c",)}
    assert slot_order(names, roles) == ("c", "d", "a", "b")
    del roles["protected"]
    assert slot_order(names, roles) == ("c", "d", "a", "b")


def test_what_plays_two_roles_has_one_slot() -> None:
    assert slot_order(["a", "b"], {"target": ("b",), "destination": ("b",)}) == ("b", "a")


def test_every_task_fits() -> None:
    assert max(len(slot_order(task.objects, task.roles)) for task in tasks().values()) <= SLOTS


def test_more_objects_than_slots_are_told() -> None:
    with pytest.raises(InputError, match=f"{SLOTS} at most"):
        slot_order([str(i) for i in range(SLOTS + 1)], {})


def test_both_signs_of_a_quaternion_are_one_row() -> None:
    other = np.concatenate([POSE[:3], -POSE[3:]])
    assert np.array_equal(filled({"a": POSE}, ("a",)), filled({"a": other}, ("a",)))


def test_an_empty_slot_is_zero_and_a_full_one_is_marked() -> None:
    row = filled({"a": POSE[None].repeat(3, 0)}, ("a",))
    assert row.shape == (3, len(SLOT_NAMES))
    slots = row.reshape(3, SLOTS, len(SLOT))
    assert slots[:, 0, :7] == pytest.approx(POSE[None].repeat(3, 0))
    assert slots[:, 0, 7].tolist() == [1, 1, 1]
    assert not slots[:, 1:].any()
