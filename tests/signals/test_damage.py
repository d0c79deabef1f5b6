"""Impact, steady force, damage and health against arithmetic on paper."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import Scene
from transforms import every_second, rebuilt

from safestage_eval.episode import Episode
from safestage_eval.evidence.declare import Options
from safestage_eval.evidence.intervals import Interval
from safestage_eval.evidence.measure import Signals

EGG: Options = (
    ("damage_scale", 0.5), ("damage_threshold", 100.0),
    ("hold_sensitivity", 0.25), ("impact_sensitivity", 1.0),
)  # fmt: skip


def get(name: str, episode: Episode, *more: tuple[str, float]) -> Interval:
    options = dict(EGG) | dict(more)
    return Signals(episode).get(name, ["a"], options=tuple(sorted(options.items())))


def moving(velocity: np.ndarray, rate: float = 100.0, scene: Scene | None = None) -> Scene:
    """A body ``a`` of 2 kg with velocities (T, 3) m/s."""
    scene = scene or Scene(len(velocity), rate)
    scene.box("a", 0.05, np.cumsum(velocity, axis=0) / rate, mass=2.0)
    track = scene.tracks["a"]
    scene.tracks["a"] = type(track)(**{**vars(track), "linear_velocity": velocity.astype("f4")})
    return scene


def bounce(rate: float = 100.0) -> Scene:
    """Falls at 3 m/s, comes back at 1 m/s from 0.5 s on."""
    velocity = np.zeros((int(rate), 3))
    velocity[:, 2] = np.where(np.arange(int(rate)) < rate / 2, -3, 1)
    return moving(velocity, rate)


@pytest.mark.parametrize(("over", "force"), [(0.05, 160), (0.1, 80), (0.01, 800)])
def test_the_impact_of_a_bounce(over: float, force: float) -> None:
    """2 kg · 4 m/s over the stated time, for just that time."""
    found = get("impact", bounce().episode(), ("over", over)).value
    assert np.isclose(found.max(), force)
    assert np.flatnonzero(found > 1e-9).tolist() == list(range(50, 50 + round(over * 100)))


def squeezed(velocity: np.ndarray) -> Scene:
    """50 N from the left, 30 N from the right, and friction that does not count."""
    scene = moving(velocity)
    for side, sign, force in (("left", 1, 50), ("right", -1, 30)):
        scene.box(side, 0.01, (-0.06 * sign, 0, 0), kind="gripper")
        normal = (sign, 0, 0)
        scene.contact(side, "a", (-0.05 * sign, 0, 0), (force * sign, 0, 7), normal)
    return scene


def test_a_steady_squeeze_counts_whole() -> None:
    found = get("quasistatic_force", squeezed(np.zeros((10, 3))).episode())
    assert np.allclose(found.value, 80)


def test_what_accelerates_the_body_does_not() -> None:
    """Sped up to the right: the 50 N go into that, the 30 N against it stay."""
    velocity = np.column_stack([np.arange(10) / 10, np.zeros((10, 2))])
    found = get("quasistatic_force", squeezed(velocity).episode()).value
    assert found[0] == pytest.approx(80)
    assert np.allclose(found[1:], 30)


def test_a_steady_squeeze_wears_down() -> None:
    """(0.25 · 80 N − 10 N) · 0.1 = 1 point every 50 ms: 10 in half a second."""
    episode = squeezed(np.zeros((51, 3))).episode()
    found = get("health", episode, ("damage_threshold", 10.0), ("damage_scale", 0.1))
    assert np.isclose(found.value[-1], 0.90)
    assert found.value[0] == 1


@pytest.mark.parametrize("name", ["damage", "health"])
def test_what_is_missing_is_said(name: str) -> None:
    episode = bounce().episode()
    cases = {
        "materials of a rule set": Signals(episode).get(name, ["a"]),
        "no contact forces": get(name, bounce().episode(force_source="none")),
    }
    body = episode.bodies["a"].model_copy(update={"mass": None})
    weightless = rebuilt(episode, header=episode.header.model_copy(update={"bodies": (body,)}))
    cases["no mass of a"] = get(name, weightless)
    for why, found in cases.items():
        assert not found.known.any()
        assert why in found.notes[0]


@given(st.integers(0, 20), st.floats(0.05, 0.2), st.floats(0, 0.3))
def test_health_only_falls_and_hardly_knows_the_rate(seed: int, over: float, scale: float) -> None:
    t = np.arange(120) / 120
    phase = np.random.default_rng(seed).uniform(0, 6, 3)
    velocity = np.column_stack([np.sin(9 * t + p) for p in phase])
    episode = moving(velocity, 120.0).episode()
    options = dict(EGG) | {"over": over, "damage_scale": scale, "damage_threshold": 1.0}
    one, two = (
        Signals(e).get("health", ["a"], options=tuple(sorted(options.items()))).value
        for e in (episode, every_second(episode))
    )
    assert (np.diff(one) <= 0).all()
    assert (one >= 0).all()
    assert (one <= 1).all()
    assert np.allclose(one[::2], two, atol=0.03)
