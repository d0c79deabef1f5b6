"""Demonstrations: references that start elsewhere and are pushed, and say when."""

from __future__ import annotations

import numpy as np
import pytest

from safestage_eval.errors import InputError
from simulate.arm.droid import HOME
from simulate.learn.disturbance import START
from simulate.policies.demonstration_policy import (
    FARTHEST,
    RETURN,
    RISE,
    SHAKE,
    Demonstration,
)
from simulate.policies.policy_names import policy_named
from simulate.policy import Observation
from simulate.record.rollout import Setting, roll_out
from simulate.tasks.task import task_named

pytestmark = pytest.mark.simulate

SETTING = Setting(task_named("fsh_orange_on_plate"), seed=3, horizon=6.0)


@pytest.fixture(scope="module")
def episode():
    return roll_out(SETTING, policy_named("demonstration:safe", SETTING.draw)).episode()


def spans(episode) -> list[tuple[int, int]]:
    (note,) = [note for note in episode.header.notes if note.startswith(START)]
    pairs = [part.split("-") for part in note.removeprefix(START).split(",")]
    return [(int(first), int(last)) for first, last in pairs]


def test_it_begins_elsewhere_and_says_when(episode) -> None:
    first, last = spans(episode)[0]
    assert first == 0
    off = np.abs(episode.frames.joint_position[(last + 1) * 8, :7] - HOME)
    assert 0.01 < off.max() < FARTHEST + 0.06


def test_a_push_is_come_back_from_and_a_closed_gripper_is_pushed_less() -> None:
    seen = Observation(0.0, HOME, 1.0, "")
    farthest = {}
    for closed in (0.0, 1.0):
        plan = np.append(HOME, closed)
        policy = Demonstration("safe", (1, 2, 3))
        policy.reset("", "")
        policy._last = plan
        policy._actions = policy._pushed(plan)
        off = np.array([policy.act(seen)[0] - plan for _ in range(RISE + RETURN)])
        assert policy.notes == (f"{START} 0-{RISE - 1}",)
        assert np.abs(off[:, 7]).max() == 0
        farthest[closed] = np.abs(off[:RISE]).max()
        assert np.abs(off[RISE:]).max() < 5 * SHAKE < farthest[closed] + 4 * SHAKE
    assert farthest[1.0] < farthest[0.0]


@pytest.mark.parametrize("name", ["demonstration", "demonstration:best", "demonstration:"])
def test_what_is_no_demonstration_is_told(name: str) -> None:
    with pytest.raises(InputError, match="demonstration:safe"):
        policy_named(name)
