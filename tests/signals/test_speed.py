"""Velocities of traces that have none: derived from the poses, and said to be."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import Scene
from transforms import rebuilt

from safestage_eval.episode import Episode, Geom
from safestage_eval.evidence.measure import Signals
from safestage_eval.geometry.pose import product, rotate

BALL = Geom(kind="sphere", size=(0.05,))


def without_twists(scene: Scene) -> Episode:
    """Velocities of an importer that had poses only: zeros."""
    zero = np.zeros((scene.frames, 3), np.float32)
    tracks = {
        name: t if len(t) == 1 else type(t)(t.position, t.orientation, zero, zero)
        for name, t in scene.tracks.items()
    }
    return rebuilt(scene.episode(), tracks=tracks)


def circling(rate: float = 120.0) -> Scene:
    """The origin circles with radius 0.5 m at 2 rad/s and turns with it; the COM is at 0.75 m."""
    t = np.arange(121) / rate
    path = 0.5 * np.column_stack([np.cos(2 * t), np.sin(2 * t), 0 * t]) + [0, 0, 1]
    turn = np.column_stack([np.cos(t), 0 * t, 0 * t, np.sin(t)])
    turn[60:] *= -1  # the same orientations
    return Scene(121, rate).body("a", BALL, path, turn, com=(0.25, 0, 0)).fixed("table")


def test_they_are_derived_from_the_poses() -> None:
    signals = Signals(without_twists(circling()))
    speed, turning = signals.get("speed", ["a"]), signals.get("angular_speed", ["a"])
    assert np.allclose(speed.value[1:-1], 0.75 * 2, rtol=2e-4)
    assert np.allclose(turning.value, 2, rtol=1e-4)
    assert np.allclose(signals.get("relative_speed", ["a", "table"]).value[1:-1], 1.5, rtol=2e-4)
    for found in (speed, turning, signals.get("vertical_speed", ["a"])):
        assert found.notes == ("the trace has no velocities of a: they are derived from its poses",)


@given(st.tuples(*[st.floats(-3, 3)] * 6))
def test_a_tumbling_body(rates: tuple[float, ...]) -> None:
    """The axis turns as well: the COM goes as its own positions say, whatever the origin does."""
    t = np.arange(40) / 200
    turn = np.array([1.0, 0, 0, 0])
    for axis, rate in enumerate(rates[:3]):
        half = np.column_stack(
            [np.cos(rate * t / 2), np.outer(np.sin(rate * t / 2), np.eye(3)[axis])]
        )
        turn = product(turn, half)
    path = np.outer(t, rates[3:])
    com = path + rotate(turn, np.array([0.3, -0.2, 0.1]))
    scene = Scene(40, 200.0).body("a", BALL, path, turn, com=(0.3, -0.2, 0.1))
    signals = Signals(without_twists(scene))
    expected = np.gradient(com, t, axis=0)[1:-1]
    found = signals.get("speed", ["a"]).value[1:-1]
    assert np.allclose(found, np.linalg.norm(expected, axis=1), atol=5e-3)
    assert np.allclose(signals.get("vertical_speed", ["a"]).value[1:-1], expected[:, 2], atol=5e-3)


def test_a_body_that_stands_still_really_has_none() -> None:
    scene = Scene(10).body("a", BALL, (0, 0, 1)).fixed("table")
    for body in ("a", "table"):
        found = Signals(without_twists(scene)).get("speed", [body])
        assert (found.value == 0).all()
        assert not found.notes


OVER = (("over", 0.1),)


def test_over_a_time_jitter_is_no_motion_but_a_drift_is() -> None:
    """Recorded 0.2 rad/s forth and back: it stays; 0.2 rad/s one way: it turns."""
    t = np.arange(121) / 120
    for way, mean in ((0 * t, 0.0), (0.2 * t, 0.2)):
        turn = np.column_stack([np.cos(way / 2), 0 * t, 0 * t, np.sin(way / 2)])
        scene = Scene(121).body("a", BALL, np.outer(way / 4, [1, 0, 0]), turn)
        track = scene.tracks["a"]
        twist = 0.2 * np.outer((-1.0) ** np.arange(121), [0, 0, 1])
        jitter = type(track)(track.position, track.orientation, twist, twist)
        signals = Signals(rebuilt(scene.episode(), tracks={"a": jitter}))
        assert np.allclose(signals.get("angular_speed", ["a"]).value, 0.2)
        found = signals.get("angular_speed", ["a"], options=OVER)
        assert np.allclose(found.value[1:], mean, atol=1e-4)
        assert np.allclose(signals.get("speed", ["a"], options=OVER).value[1:], mean / 4, atol=1e-4)


@pytest.mark.parametrize("rate", [5.0, 10.0, 30.0, 120.0])
def test_over_a_time_a_steady_motion_is_as_fast_at_any_rate(rate: float) -> None:
    """Where samples are further apart, it may have gone all of its way within that time."""
    signals = Signals(without_twists(circling(rate)))
    found = signals.get("angular_speed", ["a"], options=OVER)
    assert np.allclose(found.lower[1:], 2, rtol=1e-4)
    assert np.allclose(found.upper[1:], 2 * max(1.0, 10 / rate), rtol=1e-4)
    assert found.notes == ()


@pytest.mark.parametrize(("rate", "last"), [(120.0, 43), (5.0, 32)])
def test_over_a_time_what_was_not_measured_is_unknown_for_so_long(rate: float, last: int) -> None:
    """And the frame after it at any rate."""
    scene = Scene(60, rate).body("a", BALL, (0, 0, 0.05)).fixed("table")
    a = scene.tracks["a"]
    orientation = np.array(a.orientation)
    orientation[30] = np.nan
    tracks = {"a": type(a)(a.position, orientation, a.linear_velocity, a.angular_velocity)}
    episode = rebuilt(scene.episode(), tracks={**scene.tracks, **tracks})
    known = Signals(episode).get("angular_speed", ["a"], options=OVER).known
    assert known[:30].all() and not known[30:last].any() and known[last:].all()
