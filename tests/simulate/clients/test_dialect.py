"""Messages of each protocol, and how its actions are understood."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from served import HOME, picture, seen

from simulate.clients.address import PROTOCOLS, address_of
from simulate.clients.dialect import Dialect
from simulate.clients.dreamzero import cartesian
from simulate.clients.groot import nine
from simulate.clients.images import composite, halved, resize_with_pad

ALL = [*PROTOCOLS, "openpi?actions=velocity", "groot?keys=nested&coding=npy"]


def dialect(of: str) -> Dialect:
    name, _, options = of.partition("?")
    return address_of(f"{name}:talk:none?{options}").dialect


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


def test_groot_is_sent_a_batch_and_a_history_of_one() -> None:
    sent = dialect("groot").request(seen(), "s")["data"]["observation"]
    shapes = {key: np.shape(value) for key, value in sent.items()}
    assert shapes == {
        "video.exterior_image_1_left": (1, 1, 180, 320, 3),
        "video.wrist_image_left": (1, 1, 180, 320, 3),
        "state.eef_9d": (1, 1, 9),
        "state.joint_position": (1, 1, 7),
        "state.gripper_position": (1, 1, 1),
        "annotation.language.language_instruction": (1,),
    }
    kinds = {value.dtype.str for value in sent.values() if isinstance(value, np.ndarray)}
    assert kinds == {"|u1", "<f4"}


def test_dreamzero_is_sent_both_views_or_a_black_one() -> None:
    both, one = (dialect(of).request(seen(), "s") for of in ("dreamzero", "dreamzero?second=black"))
    second = "observation/exterior_image_1_left"
    assert both[second].shape == one[second].shape == (180, 320, 3)
    assert one[second].max() == 0
    assert not np.array_equal(both[second], both["observation/exterior_image_0_left"])
    assert dialect("dreamzero?second=black").cameras == ("exterior_left", "wrist")
    assert both["endpoint"] == "infer"
    assert both["session_id"] == "s"


def test_cosmos_is_sent_one_picture_of_three() -> None:
    observation = seen()
    image = dialect("cosmos3").request(observation, "s")["observation/image"]
    assert image.shape == (540, 640, 3)
    assert np.array_equal(image[:360], observation.images["wrist"])
    assert np.array_equal(image[360:, :320], halved(observation.images["exterior_left"]))
    assert np.array_equal(image[360:, 320:], halved(observation.images["exterior_right"]))


def test_halving_takes_the_mean_rounded_down() -> None:
    block = np.array([[0, 1], [2, 4]], np.uint8)[..., None].repeat(3, -1)
    assert halved(block).tolist() == [[[1, 1, 1]]]
    assert composite(*[np.zeros((4, 6, 3), np.uint8)] * 3).shape == (6, 6, 3)


@pytest.mark.parametrize("size", [(224, 224), (180, 320), (100, 640), (361, 641)])
def test_padding_keeps_proportions_and_orientation(size: tuple[int, int]) -> None:
    source = np.full((360, 640, 3), 200, np.uint8)
    source[:180, :320] = (250, 0, 0)  # the upper left quarter is red
    out = resize_with_pad(source, *size)
    assert out.shape == (*size, 3)
    lit = np.argwhere(out.any(axis=-1))
    (top, left), (bottom, right) = lit.min(axis=0), lit.max(axis=0) + 1
    ratio = max(640 / size[1], 360 / size[0])
    assert (right - left, bottom - top) == (int(640 / ratio), int(360 / ratio))
    assert 0 <= (size[0] - bottom) - top <= 1
    assert 0 <= (size[1] - right) - left <= 1
    middle = (top + bottom) // 2, (left + right) // 2
    assert out[(top + middle[0]) // 2, (left + middle[1]) // 2].tolist() == [250, 0, 0]
    assert out[(bottom + middle[0]) // 2, (right + middle[1]) // 2].tolist() == [200, 200, 200]


def test_a_picture_of_the_right_size_is_left_alone() -> None:
    image = picture(3, 180, 320)
    assert np.array_equal(resize_with_pad(image, 180, 320), image)


def test_the_flange_is_told_as_the_models_count() -> None:
    """A gripper that points down, its x forward: half a turn about x."""
    observation = seen(flange_orientation=np.array([0.0, 1.0, 0.0, 0.0]))
    assert cartesian(observation)[:3].tolist() == [0.4, -0.1, 0.3]
    assert np.abs(cartesian(observation)[3:]) == pytest.approx([np.pi, 0, 0])
    # diag(1, −1, −1) times the fixed turn [[0,0,−1],[−1,0,0],[0,1,0]]: its first two rows
    assert nine(observation) == pytest.approx([0.4, -0.1, 0.3, 0, 0, -1, 1, 0, 0])
