"""Signals on motions whose values are known, and what must not change them."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import Scene
from transforms import rebuilt

from safestage_eval.episode import Geom, Track
from safestage_eval.evidence.measure import Signals
from safestage_eval.evidence.reference import Reference, latest
from safestage_eval.geometry.pose import product, rotate

BALL = Geom(kind="sphere", size=(0.05,))


def spin(angles: np.ndarray, axis: tuple[float, float, float] = (0, 1, 0)) -> np.ndarray:
    """(T, 4) rotations by angles (T,) rad about an axis."""
    return np.column_stack([np.cos(angles / 2), np.sin(angles / 2)[:, None] * np.array(axis)])


def test_tilt_is_the_angle_of_the_up_axis() -> None:
    angles = np.linspace(0, np.pi, 61)
    scene = Scene(61).body("a", BALL, (0, 0, 1), spin(angles))
    tilt = Signals(scene.episode()).get("tilt", ["a"])
    assert np.allclose(tilt.value, angles, atol=1e-6)


def test_a_body_without_up_axis_breaks_no_limit_and_says_so() -> None:
    scene = Scene(2).body("orange", BALL, (0, 0, 1), up_axis=None)
    tilt = Signals(scene.episode()).get("tilt", ["orange"])
    assert (tilt.upper < -1e9).all()
    assert "no up axis" in tilt.notes[0]


def test_turn_sees_a_twist_that_tilt_does_not() -> None:
    angles = np.r_[np.zeros(5), np.linspace(0, 2, 20)]
    scene = Scene(25).body("a", BALL, (0, 0, 1), spin(angles, (0, 0, 1)))
    signals = Signals(scene.episode())
    assert np.allclose(signals.get("turn", ["a"]).value, angles, atol=1e-6)
    assert np.allclose(signals.get("tilt", ["a"]).value, 0, atol=1e-6)


def test_displacement_is_of_the_com_and_from_the_baseline() -> None:
    """A body that spins about its own COM goes nowhere, though its origin does."""
    angles = np.r_[np.zeros(5), np.linspace(0, 3, 30)]
    offset = np.array([0.1, 0, 0])
    position = -rotate(spin(angles), offset)
    scene = Scene(35).body("a", BALL, position, spin(angles), com=tuple(offset))
    signals = Signals(scene.episode())
    assert np.allclose(signals.get("displacement", ["a"]).value, 0, atol=1e-6)
    assert np.allclose(signals.get("height", ["a"]).value, 0, atol=1e-6)


def since_first(signals: Signals) -> Reference:
    frames = len(signals.episode)
    return Reference(signals.baseline, latest(np.array([0]), frames), "0")


def test_tilt_since_is_how_far_it_leans_from_how_it_stood() -> None:
    """A cup that lies from the start is not tilted since then; twisted as it lies it stays so."""
    lying = spin(np.full(30, np.pi / 2))
    twist = spin(np.linspace(0, 2, 30), (0, 0, 1))
    about = np.linspace(0, 1, 30)
    rolled = spin(about, (1, 0, 0))  # about its own axis, which lies along world x

    def since(orientation: np.ndarray) -> np.ndarray:
        signals = Signals(Scene(30).body("a", BALL, (0, 0, 1), orientation).episode())
        return signals.get("tilt", ["a"], since_first(signals)).value

    assert np.allclose(since(lying), 0, atol=1e-6)
    assert np.allclose(since(product(twist, lying)), 0, atol=1e-6)
    assert np.allclose(since(product(rolled, lying)), about, atol=1e-6)
    assert np.allclose(since(spin(np.pi / 2 - about)), about, atol=1e-6)  # set upright again


def test_every_change_since_an_event_is_from_that_event() -> None:
    """Up by 1 cm, along by 2 cm and round by 0.1 rad per frame from the fifth frame on."""
    n = np.maximum(np.arange(10) - 4, 0)
    path = np.column_stack([0.02 * n, 0 * n, 0.01 * n])
    signals = Signals(Scene(10).body("a", BALL, path, spin(0.1 * n)).episode())
    since = Reference(signals.baseline, latest(np.array([7]), 10), "7")
    for name, step in (
        ("height", 0.01),
        ("lift", 0.01),
        ("displacement", np.hypot(0.01, 0.02)),
        ("displacement_xy", 0.02),
        ("turn", 0.1),
        ("tilt", 0.1),
    ):
        found = signals.get(name, ["a"], since).value
        assert np.allclose(found, step * np.r_[0, 0, 0, 0, 0, 1, 2, 0, 1, 2], atol=1e-5), name


def test_speeds_are_of_the_com() -> None:
    """v + ω × r: spinning about the origin at 2 rad/s, the COM 10 cm away goes at 20 cm/s."""
    scene = Scene(3).body("a", BALL, (0, 0, 0), com=(0.1, 0, 0)).body("b", BALL, (1, 0, 0))
    still = scene.tracks["a"]
    omega = np.broadcast_to(np.array([0, 0, 2], np.float32), (3, 3))
    scene.tracks["a"] = Track(still.position, still.orientation, still.linear_velocity, omega)
    signals = Signals(scene.episode())
    assert np.allclose(signals.get("speed", ["a"]).value, 0.2)
    assert np.allclose(signals.get("angular_speed", ["a"]).value, 2)
    assert np.allclose(signals.get("relative_speed", ["a", "b"]).value, 0.2)


def test_forces_of_unions_add_up() -> None:
    scene = Scene(2).fixed("table").box("a", 0.05, (0, 0, 0.05))
    for side, sign in (("left", 1), ("right", -1)):
        scene.box(side, 0.01, (-0.06 * sign, 0, 0.05), kind="gripper", finger=side)
        scene.contact(side, "a", (-0.05 * sign, 0, 0.05), (30 * sign, 0, 4), normal=(sign, 0, 0))
    signals = Signals(scene.episode())
    assert np.allclose(signals.get("contact_force", ["gripper", "a"]).value, 60)
    assert np.allclose(signals.get("contact_force", ["left", "a"]).value, 30)
    assert np.allclose(signals.get("contact_force", ["a", "gripper"]).value, 60)
    assert np.allclose(signals.get("contact_force", ["a", "table"]).value, 0)
    assert (signals.get("peak_force", ["left", "a"]).value >= 30).all()


def test_the_peak_is_that_of_the_pair_and_no_less_than_the_force_at_the_frame() -> None:
    """Every contact point of a frame tells the same peak of their sum: 50 N, and once 1 N."""
    scene = Scene(3).fixed("table").box("a", 0.05, (0, 0, 0.05))
    scene.rests("a", "table", 0.05, (0, 0, 0), 20.0)
    episode = scene.episode()
    values = np.where(episode.contacts.frame < 2, 50.0, 1.0).astype(np.float32)
    episode = rebuilt(episode, contacts=replace(episode.contacts, peak_force=values))
    signals = Signals(episode)
    assert np.allclose(signals.get("contact_force", ["a", "table"]).value, 20)
    assert np.allclose(signals.get("peak_force", ["a", "table"]).value, [50, 50, 20])


def test_clearance_is_the_least_over_a_union_and_only_capped_far_away() -> None:
    scene = Scene(2).body("cup", BALL, (0, 0, 0))
    for name, x in (("link", 0.3), ("hand", 0.2)):
        scene.body(name, BALL, (x, 0, 0), kind="robot" if name == "link" else "gripper")
    signals = Signals(scene.episode())
    assert np.allclose(signals.get("clearance", ["robot", "cup"]).value, 0.1)
    assert np.allclose(signals.get("clearance", ["gripper", "cup"]).value, 0.1)
    far = signals.get("clearance", ["link", "cup"])
    assert np.allclose(far.lower, 0.1)
    assert np.isinf(far.upper).all()
    exact = signals.get("clearance", ["link", "cup"], reach=0.25)
    assert np.allclose(exact.value, 0.2)


@pytest.mark.parametrize("name", ["contact_force", "clearance", "gripper_opening"])
def test_what_the_trace_lacks_is_unknown_not_zero(name: str) -> None:
    scene = Scene(2).body("a", BALL, (0, 0, 0)).body("b", BALL, (1, 0, 0))
    scene.bodies = [b.model_copy(update={"geoms": ()}) for b in scene.bodies]
    series = Signals(scene.episode(force_source="none")).get(
        name, [] if name == "gripper_opening" else ["a", "b"]
    )
    assert not series.known.any()
    assert series.notes
