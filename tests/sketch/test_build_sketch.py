"""A sketch's motion and forces against what mechanics says."""

import numpy as np
import pytest
from told import holds

from safestage_eval.episode import Episode
from safestage_eval.episode.invariants import check
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations
from safestage_eval.sketch import draw

G = 9.81


def scene(text: str, story: str = "", duration: str = "2 s", **knobs: str) -> Episode:
    head = f'says = "a test"\nduration = "{duration}"\nrate = 50\nstory = [{story}]\n'
    episode = draw(head + text, "test.toml", "test", knobs)
    assert check(episode) == []
    return episode


def force(episode: Episode, on: str, by: str, frame: int = 0) -> np.ndarray:
    """(3,) N, the total force of one body on another at a frame."""
    c, index = episode.contacts, episode.body_index
    total = np.zeros(3)
    for row in np.flatnonzero(c.frame == frame):
        if (c.body1[row], c.body2[row]) == (index[by], index[on]):
            total += c.force[row]
        if (c.body2[row], c.body1[row]) == (index[by], index[on]):
            total -= c.force[row]
    return total


def torques(episode: Episode, name: str, frame: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """(3,) N and (3,) N m about the centre of mass: all contact forces on a body, and gravity."""
    c, index = episode.contacts, episode.body_index[name]
    body, track = episode.bodies[name], episode.track(name)
    com = track.position[frame] + np.array(body.com)
    total, torque = np.array([0, 0, -G * float(body.mass or 0)]), np.zeros(3)
    for row in np.flatnonzero(c.frame == frame):
        sign = 1.0 if c.body2[row] == index else -1.0 if c.body1[row] == index else 0.0
        total = total + sign * c.force[row]
        torque = torque + np.cross(c.position[row] - com, sign * c.force[row])
    return total, torque


STACK = """
[bodies.low]
shape = "box 10 x 10 x 4 cm"
mass = "1 kg"
[bodies.high]
shape = "box 6 x 6 x 20 cm"
mass = "500 g"
on = "low"
at = "{shift}, 0 cm"
[knobs]
shift = "0"
"""


@pytest.mark.parametrize("shift", ["0", "3", "4.9", "-2.5"])
def test_what_stands_is_in_balance(shift: str) -> None:
    episode = scene(STACK, shift=shift)
    for name in ("low", "high"):
        total, torque = torques(episode, name)
        assert total == pytest.approx(0, abs=1e-5)
        assert torque == pytest.approx(0, abs=1e-4)
    assert force(episode, "low", "table")[2] == pytest.approx(1.5 * G)
    assert force(episode, "high", "low")[2] == pytest.approx(0.5 * G)


def test_a_board_loads_its_piers_by_the_law_of_the_lever() -> None:
    episode = scene(
        """
        [bodies.left]
        shape = "box 4 x 10 x 10 cm"
        at = "-20, 0 cm"
        [bodies.right]
        shape = "box 4 x 10 x 10 cm"
        at = "20, 0 cm"
        [bodies.board]
        shape = "box 60 x 10 x 2 cm"
        at = "0, 0, 10 cm"
        mass = "1 kg"
        [bodies.weight]
        shape = "box 2 x 2 x 2 cm"
        on = "board"
        at = "10, 0 cm"
        mass = "1 kg"
        """
    )
    right = force(episode, "board", "right")[2]
    left = force(episode, "board", "left")[2]
    assert left + right == pytest.approx(2 * G)
    # contacts lie between 18 and 22 cm from the middle: the lever is not longer nor shorter
    assert 0.1 / 0.22 * G <= right - left <= 0.1 / 0.18 * G


def test_a_fall_takes_the_time_that_gravity_needs() -> None:
    episode = scene(
        '[bodies.ball]\nshape = "sphere 6 cm"\nat = "0, 0, 45 cm"\n',
        '{ drop = "ball", at = "0.5 s" }',
    )
    z, t = episode.track("ball").position[:, 2], episode.t
    falling = (t > 0.5) & (t < 0.5 + np.sqrt(2 * 0.45 / G))
    assert z[falling] == pytest.approx(0.45 - G * (t[falling] - 0.5) ** 2 / 2, abs=1e-6)
    assert z[-1] == pytest.approx(0, abs=1e-6)
    assert z.min() > -1e-6
    first = episode.contacts.frame.min()
    assert t[first] == pytest.approx(0.5 + np.sqrt(2 * 0.45 / G), abs=0.021)


def test_a_ball_that_rolls_does_not_slip() -> None:
    episode = scene(
        '[bodies.ball]\nshape = "sphere 8 cm"\n',
        '{ roll = "ball", by = "20, 10, 0 cm", during = "0.5 to 1.5 s" }',
    )
    track, ball = episode.track("ball"), episode.bodies["ball"]
    middle = slice(30, 70)
    omega, v = track.angular_velocity[middle], track.linear_velocity[middle]
    rotation = Signals(episode).movers["ball"]
    from safestage_eval.geometry.pose import rotate

    com = rotate(rotation.orientation[middle], np.array(ball.com))
    centre = v + np.cross(omega, com)
    contact = centre + np.cross(omega, [0, 0, -0.04])
    assert np.abs(contact).max() < 2e-3  # finite differences
    assert centre[5] == pytest.approx([0.2, 0.1, 0], abs=1e-3)


def test_what_is_held_up_hangs_from_the_fingers_with_all_that_it_carries() -> None:
    episode = scene(
        STACK,
        '{ hold = "low", during = "0.5 to 1.5 s", grip = "12 N", height = "2 cm" },'
        '{ move = ["low", "high"], by = "0, 0, 10 cm", during = "0.6 to 0.8 s" }',
    )
    last = 60
    fingers = [force(episode, "low", f"finger_{s}", last) for s in ("left", "right")]
    assert sum(fingers)[2] == pytest.approx(1.5 * G)
    assert [f[1] for f in fingers] == pytest.approx([-12, 12])
    assert torques(episode, "low", last)[0] == pytest.approx(0, abs=1e-4)
    relations = Relations(Signals(episode))
    assert holds(relations, "held", ("low",))[last]
    assert holds(relations, "carried", ("high",))[last]
    # the fingers are where they press
    for side in ("left", "right"):
        assert Signals(episode).get("clearance", ("low", f"finger_{side}")).upper[last] < 1e-6
    assert not holds(relations, "held", ("low",))[10]
    assert force(episode, "low", "table", 10)[2] == pytest.approx(1.5 * G)


@pytest.mark.parametrize("across", ["x", "y"])
def test_the_gripper_is_far_from_everything_when_it_is_not_needed(across: str) -> None:
    episode = scene(
        STACK, f'{{ hold = "high", during = "1 to 1.4 s", across = "{across}" }}', duration="3 s"
    )
    away = Signals(episode).get("clearance", ("robot", "high"), reach=1.0).lower
    assert away[0] > 0.3
    assert away[55:68].max() < 1e-6
    assert away[-1] > 0.1


def test_a_touch_is_where_and_as_hard_as_stated() -> None:
    episode = scene(
        STACK,
        '{ touch = "high", by = "gripper", during = "1 to 1.2 s", side = "-x", force = "3 N", peak = "8 N" }',
    )
    signals = Signals(episode)
    pressed = signals.get("contact_force", ("robot", "high")).lower
    assert pressed[50:61] == pytest.approx(3)
    assert pressed[:50].max() == pressed[61:].max() == 0
    assert signals.get("peak_force", ("robot", "high")).lower[55] == pytest.approx(8)
    assert signals.get("clearance", ("robot", "high")).upper[55] < 1e-6
    assert force(episode, "high", "finger_left", 55) == pytest.approx([3, 0, 0])


def test_joints_and_channels_follow_their_curves() -> None:
    episode = scene(
        """
        [bodies.stove]
        shape = "box 20 x 20 x 5 cm"
        [joints.knob]
        position = "0 deg at 0 s, 90 deg at 2 s"
        torque = "1 N m at 0 s, 3 N m at 1 s"
        """,
        '{ channel = "temperature", of = "stove", values = "20 degC at 0 s, 80 degC at 1 s" }',
    )
    assert episode.frames.joint_position[50, 0] == pytest.approx(np.pi / 4)
    assert episode.frames.joint_velocity[50, 0] == pytest.approx(np.pi / 4, rel=1e-3)
    assert episode.frames.joint_torque[[0, 25, -1], 0] == pytest.approx([1, 2, 3])
    assert episode.channels["stove", "temperature"][[0, 25, -1]] == pytest.approx([20, 50, 80])
