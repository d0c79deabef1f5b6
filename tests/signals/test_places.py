"""The workspace box, recorded scalars, norms of a displacement."""

import numpy as np
import pytest
from scenes import Scene
from transforms import rebuilt

from safestage_eval.episode import Geom
from safestage_eval.evidence.measure import Signals

BOX = (-0.5, -1.0, 0.0, 0.5, 1.0, 2.0)


def test_workspace_margin_is_of_the_whole_body() -> None:
    """A cylinder of radius 0.1 m and height 0.4 m goes out through the face x = 0.5."""
    x = np.array([0.0, 0.3, 0.4, 0.5, 0.7])
    scene = Scene(5).body(
        "a", Geom(kind="cylinder", size=(0.1, 0.2)), np.column_stack([x, 0 * x, 0 * x + 1])
    )
    found = Signals(scene.episode()).get("workspace_margin", ["a"], options=(("box", BOX),))
    assert np.allclose(found.value, [0.4, 0.1, 0, -0.1, -0.3], atol=1e-6)


@pytest.mark.parametrize(
    ("position", "margin"), [((0, 0.9, 1), 0.0), ((0, 0, 0.2), 0.1), ((0, 0, 2.3), -0.4), ((-0.45, 0, 1), -0.05)]
)  # fmt: skip
def test_every_face_counts(position: tuple[float, ...], margin: float) -> None:
    scene = Scene(1).body("a", Geom(kind="sphere", size=(0.1,)), position)
    found = Signals(scene.episode()).get("workspace_margin", ["a"], options=(("box", BOX),))
    assert found.value[0] == pytest.approx(margin, abs=1e-6)


def channel(body: str, **options: str):
    heat = np.linspace(293.15, 353.15, 4)
    scene = Scene(4).box("pan", 0.1, (0, 0, 0)).box("egg", 0.1, (1, 0, 0))
    for name in ("arm", "hand"):
        scene.box(name, 0.1, (2, 0, 0), kind="robot")
    channels = {("pan", "heat"): heat, ("arm", "load"): 0 * heat + 3, ("pan", "fill"): heat / 10}
    episode = rebuilt(scene.episode(), channels=channels)
    return Signals(episode).get("channel", [body], options=tuple(sorted(options.items())))


def test_a_channel_in_the_unit_it_was_recorded_in() -> None:
    plain, kelvin = channel("pan", channel="heat"), channel("pan", channel="heat", unit="K")
    assert plain.dimension == "number"
    assert np.allclose(plain.value, np.linspace(293.15, 353.15, 4))
    assert kelvin.dimension == "temperature"
    assert np.allclose(kelvin.value, np.linspace(20, 80, 4))
    assert np.allclose(channel("pan", channel="heat", unit="degC").value, plain.value)
    assert np.allclose(channel("pan", channel="fill", unit="%").value, plain.value / 1000)


def test_a_channel_that_is_not_there_is_unknown() -> None:
    found = channel("egg", channel="heat", unit="degC")
    assert not found.known.any()
    assert found.notes == ("the trace has no channel heat of egg",)
    assert np.allclose(channel("robot", channel="load").value, 3)


@pytest.mark.parametrize(("norm", "expected"), [("l2", 0.05), ("l1", 0.07), ("max", 0.04)])
def test_norms_of_a_displacement(norm: str, expected: float) -> None:
    path = np.array([(0, 0, 0)] * 5 + [(0.03, -0.04, 0)], float)
    signals = Signals(Scene(6).box("a", 0.1, path).episode())
    for name in ("displacement", "displacement_xy"):
        found = signals.get(name, ["a"], options=(("norm", norm),)).value
        assert found[-1] == pytest.approx(expected, abs=1e-6)
