"""A user's own policy: found by import path, sees what it asks for, and never the true state."""

from __future__ import annotations

import gc
import types
from typing import Any

import mujoco
import numpy as np
import pytest
from own_policies import Seeing, Still

from safestage_eval.errors import InputError
from simulate.policies.policy_names import policy_name, policy_named
from simulate.policy import Observation
from simulate.record.rollout import Setting, roll_out
from simulate.tasks.task import Placement, Task, task_named
from simulate.world.privileged import PrivilegedState
from simulate.world.world import World

pytestmark = pytest.mark.simulate

TASK = task_named("fsh_bottle_on_shelf")
SHORT = Setting(TASK, horizon=0.5)
PRIVATE = (mujoco.MjData, mujoco.MjModel, World, PrivilegedState, Task, Placement)


def reachable(start: Any) -> list[Any]:
    """Everything that can be got at from an object, classes and modules left alone."""
    seen: dict[int, Any] = {}
    todo = [start]
    while todo:
        item = todo.pop()
        if id(item) in seen or isinstance(item, type | types.ModuleType | types.FunctionType):
            continue
        seen[id(item)] = item
        todo += gc.get_referents(item)
        if isinstance(item, np.ndarray) and item.base is not None:
            todo.append(item.base)
    return list(seen.values())


def test_what_a_policy_is_handed_leads_to_no_true_state() -> None:
    policy = Still()
    roll_out(SHORT, policy)
    observations = [item for item in policy.handed if isinstance(item, Observation)]
    assert len(observations) == 8
    found = [type(item) for item in reachable(policy.handed) if isinstance(item, PRIVATE)]
    assert found == []
    assert policy.handed[:2] == [TASK.id, TASK.prompts.default]
    numbers = {len(v) for o in observations for v in (o.joint_position, o.joint_velocity)}
    assert numbers == {7}


@pytest.mark.slow
def test_cameras_see_and_change_nothing() -> None:
    policy = Seeing()
    seen = roll_out(SHORT, policy).episode()
    blind = roll_out(SHORT, Still()).episode()
    assert np.array_equal(seen.frames.joint_position, blind.frames.joint_position)
    for name, track in blind.tracks.items():
        assert np.array_equal(seen.tracks[name].position, track.position), name
    assert [item for item in reachable(policy.handed) if isinstance(item, PRIVATE)] == []
    first = policy.handed[2].images
    assert set(first) == {"external", "wrist"}
    for image in first.values():
        assert image.shape == (48, 64, 3)
        assert image.std() > 5, "an empty picture"
    assert not np.array_equal(first["external"], first["wrist"])


def test_by_import_path() -> None:
    assert policy_name("own_policies:Still") == "still"
    assert type(policy_named("own_policies:Still")).__name__ == "Still"
    assert policy_named("own_policies:Still") is policy_named("own_policies:Still")


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("no_such_module:Still", "No module named 'no_such_module'"),
        ("own_policies:Stil", "no class 'Stil'"),
        ("own_policies:Unnamed", "no act, no name"),
    ],
)
def test_what_is_no_policy(path: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        policy_named(path)
