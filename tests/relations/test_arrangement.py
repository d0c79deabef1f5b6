"""Over which frames bodies lie alike on each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import G, Scene

from safestage_eval.relations.arrangement import SHIFTED, TURNED, Cluster, Recording
from safestage_eval.relations.graph import Assemblies


def cluster(scene: Scene) -> Cluster:
    episode = scene.episode()
    recording = Recording(episode, Assemblies(episode.header.bodies))
    return Cluster(recording, recording.assemblies.free, episode.contacts.pairs)


def board(path: np.ndarray, orientation: object = (1, 0, 0, 0)) -> Scene:
    """A board that is taken along a path (T, 3), and a cup on it."""
    scene = Scene(len(path)).fixed("table")
    scene.body("board", scene.bodies[0].geoms[0], path, orientation)
    scene.box("cup", 0.03, np.add(path, (0, 0, 0.05)), orientation=orientation)
    for t, at in enumerate(path):
        scene.rests("cup", "board", 0.03, np.add(at, (0, 0, 0.02)), G, frames=slice(t, t + 1))
    return scene


@given(st.floats(-3, 3), st.floats(-1, 1), st.floats(-1, 1))
@settings(deadline=None, max_examples=20)
def test_what_goes_along_as_one_lies_alike_however_far(yaw: float, x: float, y: float) -> None:
    part = np.linspace(0, 1, 30)[:, None]
    spin = np.stack([np.cos(yaw * part / 2), 0 * part, 0 * part, np.sin(yaw * part / 2)], 1)
    found = cluster(board(part * [x, y, 0], spin[..., 0]))
    assert (found.stretch(found.free[0]) == 0).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_tilt_is_another_arrangement(axis: int) -> None:
    """Of what leans, not of what turns about the vertical."""
    angle = np.linspace(0, 3.5 * TURNED, 36)
    orientation = np.zeros((36, 4))
    orientation[:, 0], orientation[:, 1 + axis] = np.cos(angle / 2), np.sin(angle / 2)
    found = cluster(board(np.zeros((36, 3)), orientation))
    assert len(np.unique(found.stretch(found.free[0]))) == (1 if axis == 2 else 4)


def test_what_slides_over_another_lies_otherwise_every_millimetre() -> None:
    scene = (
        Scene(41)
        .fixed("table")
        .box("cup", 0.03, np.linspace(0, 4 * SHIFTED, 41)[:, None] * [1, 0, 0])
    )
    scene.rests("cup", "table", 0.03, (0, 0, 0), G)
    found = cluster(scene)
    first = found.stretch(1)
    assert np.diff(np.unique(first)).max() <= 11
    assert len(np.unique(first)) == 4


def resting(gone: slice, goes: float = 0.0, touched: int | None = None) -> Cluster:
    """A cup on a table whose contact is missing at some frames; it may go on, or the hand touch it."""
    way = np.where(np.arange(30) >= 15, goes, 0.0)
    scene = Scene(30).fixed("table").box("cup", 0.03, way[:, None] * [1, 0, 0] + [0, 0, 0.03])
    scene.box("finger", 0.01, (0.04, 0, 0.03), kind="gripper", finger="left")
    for t in sorted(set(range(30)) - set(range(30)[gone])):
        scene.rests("cup", "table", 0.03, (way[t], 0, 0), G, frames=slice(t, t + 1))
    if touched is not None:
        scene.contact(
            "finger", "cup", (0.03, 0, 0.03), (-0.1, 0, 0), (-1, 0, 0), slice(touched, touched + 1)
        )
    return cluster(scene)


def test_a_contact_that_is_missing_lasts_while_nothing_happens() -> None:
    def present(found: Cluster) -> list[int]:
        return np.flatnonzero(found.touching[found.pairs.index((0, 1))]).tolist()

    assert present(resting(slice(10, 20))) == list(range(30))
    assert present(resting(slice(0, 20))) == list(range(30))
    assert present(resting(slice(10, 30), goes=0.01)) == list(range(15))
    assert present(resting(slice(10, 20), touched=12)) == [t for t in range(30) if t != 12]


def test_chains_join_what_they_lead_to_frame_by_frame() -> None:
    scene = Scene(3).fixed("table")
    for k, name in enumerate("abc"):
        scene.box(name, 0.05, np.array([[0, 0, 0.05 + 0.1 * k]] * 2 + [[k, 0, 2.0]]))
    scene.rests("a", "table", 0.05, (0, 0, 0), 3 * G)
    scene.rests("b", "a", 0.05, (0, 0, 0.1), 2 * G, frames=slice(0, 2))
    scene.rests("c", "b", 0.05, (0, 0, 0.2), G, frames=slice(1, 2))
    found = cluster(scene)
    assert found.linked(3, [1]).tolist() == [True, True, False]  # at first it stays where it was
    assert found.linked(2, [1]).tolist() == [True, True, False]
    assert found.linked(1, [0]).all()
    assert found.linked(3, [0]).tolist() == [True, True, False]
