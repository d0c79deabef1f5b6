"""Messages of each protocol, and how its actions are understood."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from served import HOME, seen

from simulate.clients.address import PROTOCOLS, dialect_of
from simulate.clients.dialect import Dialect

ALL = [*PROTOCOLS, "openpi?actions=velocity", "groot?keys=nested"]


def dialect(of: str) -> Dialect:
    return dialect_of(of)


def grip(of: Dialect, *values: float) -> Any:
    """Gripper commands as understood from an answer with these."""
    actions = np.tile(np.append(HOME, 0.0), (len(values), 1))
    actions[:, 7] = values
    return of.actions(of.answer(actions, seen()), seen())[:, 7]


@pytest.mark.parametrize("of", ALL)
def test_a_server_understands_what_a_client_sends(of: str) -> None:
    observation, kind = seen(), dialect(of)
    asked = kind.asked(kind.request(observation, "session 1"))
    found = asked.observation
    assert found.joint_position == pytest.approx(observation.joint_position, abs=1e-6)
    assert found.gripper_opening == pytest.approx(0.75)
    assert found.instruction == observation.instruction
    assert set(found.images) == set(kind.cameras)
    assert asked.session == ("session 1" if of in ("dreamzero", "cosmos3") else None)


@pytest.mark.parametrize("of", ALL)
def test_a_client_understands_what_a_server_answers(of: str) -> None:
    kind, observation = dialect(of), seen()
    actions = np.append(observation.joint_position, 0.0) + np.cumsum(np.full((12, 8), 0.01), axis=0)
    actions[:, 7] = np.arange(12) % 2
    found = kind.actions(kind.answer(actions, observation), observation)
    assert found == pytest.approx(actions, abs=1e-6)


@pytest.mark.parametrize("of", ALL)
def test_the_gripper_closes_above_one_half_and_is_sent_as_droid_counts(of: str) -> None:
    kind = dialect(of)
    assert grip(kind, 0.0, 0.49, 0.5, 0.51, 1.0, 1.3, -0.2).tolist() == [0, 0, 0, 1, 1, 1, 0]
    request = kind.request(seen(gripper_opening=1.0), "s")
    if of.startswith("groot"):
        sent = request["data"]["observation"]
        value = (
            sent["state.gripper_position"]
            if "state" not in sent
            else sent["state"]["gripper_position"]
        )
    else:
        value = request["observation/gripper_position"]
    assert np.ravel(value).tolist() == [0.0], "open is 0"


def test_velocities_are_added_up_from_the_measured_position() -> None:
    """0.2 rad per control step at a velocity of 1; more than 1 is cut (DROID)."""
    answer = {
        "actions": np.array([[1, 0, 0, 0, 0, 0, -0.5, 0], [3, 0, 0, 0, 0, 0, -0.5, 0]], float)
    }
    observation = seen(joint_position=np.arange(7.0))
    found = dialect("openpi?actions=velocity").actions(answer, observation)
    assert found[:, 0].tolist() == pytest.approx([0.2, 0.4])
    assert found[:, 6].tolist() == pytest.approx([5.9, 5.8])
    assert found[:, 3].tolist() == [3.0, 3.0]


@pytest.mark.parametrize(
    ("of", "answer"),
    [
        ("openpi", {}),
        ("openpi", {"actions": np.zeros((15, 7))}),
        ("openpi", {"actions": np.zeros(8)}),
        ("openpi", np.zeros((15, 8))),
        ("groot", {"action.joint_position": np.zeros((1, 8, 7))}),
        ("groot", [{"action.joint_position": np.zeros((1, 8, 7))}, {}]),
        (
            "groot",
            [{"joint_position": np.zeros((1, 8, 7)), "gripper_position": np.zeros((1, 9, 1))}, {}],
        ),
        ("dreamzero", np.zeros((24, 7))),
        ("cosmos3", {"type": "error", "message": "no GPU"}),
        ("cosmos3", {"video": 1}),
    ],
)
def test_what_is_no_answer_is_refused(of: str, answer: Any) -> None:
    with pytest.raises((KeyError, ValueError, TypeError, IndexError)):
        dialect(of).actions(answer, seen())
