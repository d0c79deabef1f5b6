"""The impulse of contacts: known pulses, and what is not known between frames."""

import numpy as np
from scenes import Scene
from transforms import rebuilt

from safestage_eval.episode import Episode
from safestage_eval.evidence.intervals import Interval
from safestage_eval.evidence.measure import Signals


def pushed(forces: dict[str, list[float]], rate: float = 100.0, **header: float) -> Episode:
    """A box ``a``, and pushers with the normal force of each frame (N)."""
    frames = len(next(iter(forces.values())))
    scene = Scene(frames, rate).box("a", 0.05, (0, 0, 0))
    for name, series in forces.items():
        scene.box(name, 0.05, (0.1, 0, 0), kind="robot")
        for frame, force in enumerate(series):
            if force:
                scene.contact(
                    name, "a", (0.05, 0, 0), (-force, 0, 0), (-1, 0, 0), slice(frame, frame + 1)
                )
    return scene.episode(**header)


def impulse(episode: Episode, *bodies: str) -> Interval:
    return Signals(episode).get("impulse", bodies)


def test_a_constant_push() -> None:
    """5 N for 0.2 s is 1 N s; nothing once they have parted; the next push starts anew."""
    found = impulse(pushed({"b": [0] * 5 + [5] * 20 + [0] * 5 + [2] * 10 + [0]}), "a", "b").value
    assert np.allclose(found[5:25], 0.05 * np.arange(1, 21))
    assert np.allclose(found[25:30], 0)
    assert np.allclose(found[30:40], 0.02 * np.arange(1, 11))
    assert found[40] == 0


def test_a_half_sine_pulse() -> None:
    """∫ F sin(π t / T) dt = 2 F T / π, and that is m Δv of what it stops."""
    t = np.arange(1, 100) / 1000
    found = impulse(pushed({"b": [0, *(30 * np.sin(np.pi * t / 0.1)), 0]}, 1000.0), "a", "b")
    assert np.isclose(found.value.max(), 2 * 30 * 0.1 / np.pi, rtol=1e-3)


def test_a_touch_between_two_frames_is_bounded_by_its_peak() -> None:
    """Four physics steps of 2.5 ms per frame, force known at the last only."""
    episode = pushed({"b": [0, 8, 0]}, physics_dt=0.0025)
    rows = episode.contacts
    hidden = rebuilt(episode, contacts=type(rows)(**{**vars(rows), "force": rows.force * 0}))
    found = impulse(hidden, "a", "b")
    assert np.allclose(found.lower, [0, 8 * 0.0025, 0])
    assert np.allclose(found.upper, [0, 8 * 0.01, 0])


def test_a_trace_without_forces_does_not_tell() -> None:
    found = impulse(pushed({"b": [1, 1]}, force_source="none"), "a", "b")
    assert not found.known.any()
    assert found.notes
