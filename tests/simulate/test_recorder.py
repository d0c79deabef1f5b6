"""Recordings are true: forces, velocities, shapes and times."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from worlds import STILL, force_on, put, recorder_of, recording, world_of

from safestage_eval.episode import Episode, check
from simulate.catalogue.objects import ObjectModel, Shape
from simulate.world.world import World

pytestmark = pytest.mark.simulate

G = 9.81
LOPSIDED = ObjectModel(
    mass=0.5,
    height=0.1,
    shapes=(
        Shape(kind="box", size=(0.01, 0.02, 0.05), position=(0, 0, 0.05), share=0.4),
        Shape(kind="box", size=(0.05, 0.02, 0.01), position=(0.06, 0, 0.09), share=0.6),
    ),
)


@pytest.fixture(scope="module")
def standing() -> tuple[World, Episode]:
    """A can and a bin with a lemon on the table, at rest, and the arm moving above them."""
    world = world_of("soup_can", "small_bin", "lemon")
    put(world, soup_can=[0.5, 0.2, 0], small_bin=[0.5, -0.2, 0], lemon=[0.5, -0.2, 0.005])
    for _ in range(15):
        world.act(STILL)
    return world, recording(world, 10, STILL + np.array([0.3, 0.1, 0.2, 0.1, 0.3, 0.2, 0.5, 0]))


def test_a_recording_breaks_no_invariant(standing: tuple[World, Episode]) -> None:
    assert check(standing[1]) == []


@pytest.mark.parametrize(("name", "load"), [("soup_can", 0.35), ("lemon", 0.10)])
def test_forces_on_a_resting_body_balance_its_weight(
    standing: tuple[World, Episode], name: str, load: float
) -> None:
    force = force_on(standing[1], name)
    assert force[:, 2].mean() == pytest.approx(load * G, rel=0.01)
    assert np.abs(force[:, :2].mean(axis=0)).max() < 0.01 * load * G


def test_friction_is_part_of_the_force(standing: tuple[World, Episode]) -> None:
    world, _ = standing
    put(world, soup_can=[0.5, 0.2, 0], small_bin=[0.5, -0.2, 0], lemon=[0.8, 0.4, 0])
    world.model.opt.gravity = [1.5, -1.0, -9.0]  # as on a slope
    try:
        for _ in range(15):
            world.act(STILL)
        force = force_on(recording(world, 4), "soup_can").mean(axis=0)
    finally:
        world.model.opt.gravity = [0, 0, -G]
    assert force == pytest.approx([-0.35 * 1.5, 0.35 * 1.0, 0.35 * 9.0], rel=0.03)


def test_normals_point_from_body_1_to_body_2(standing: tuple[World, Episode]) -> None:
    episode = standing[1]
    contacts = episode.contacts
    standing_on = contacts.between(
        frozenset({episode.body_index["table"]}), frozenset({episode.body_index["soup_can"]})
    )
    assert standing_on.any()
    up = 1 if episode.body_index["table"] < episode.body_index["soup_can"] else -1
    assert contacts.normal[standing_on, 2] * up == pytest.approx(1, abs=1e-3)
    along = np.einsum("ij,ij->i", contacts.normal, contacts.force)
    assert (along >= -1e-4).all()


def test_velocities_are_those_of_the_frame_origin() -> None:
    world = world_of(more={"boomerang": LOPSIDED})
    put(world, boomerang=[0.5, 0.3, 0.8])
    start = world.model.joint("boomerang/free").dofadr[0]
    world.data.qvel[start : start + 6] = [0.3, -0.5, 1.0, 2.0, -5.0, 3.0]
    action = STILL + np.array([0.3, 0.1, 0.2, 0.1, 0.3, 0.2, 0.5, 0])
    episode = recording(world, 3, action)
    assert np.linalg.norm(np.asarray(episode.bodies["boomerang"].com)) > 0.05
    for name in ("boomerang", "robot_link3", "robot_link6", "robot_base"):
        track = episode.tracks[name]
        position, turned = track.position.astype(float), track.orientation.astype(float)
        # semi-implicit Euler moves a body by its new velocity; turning leaves a second-order rest
        moved = np.diff(position, axis=0) * 120
        speed = track.linear_velocity[1:]
        assert np.abs(moved - speed).max() < 0.03 * np.abs(speed).max() + 0.01, name
        rotation = Rotation.from_quat(turned, scalar_first=True)
        turn = (rotation[1:] * rotation[:-1].inv()).as_rotvec() * 120
        spin = track.angular_velocity[1:]
        assert np.abs(turn - spin).max() < 0.03 * np.abs(spin).max() + 0.01, name


def test_peaks_keep_what_happens_between_frames() -> None:
    world = world_of("orange", substeps=4)
    put(world, orange=[0.5, 0.3, 0.10])
    contacts = recording(world, 15).contacts
    total = np.zeros(120)
    normal = np.einsum("ij,ij->i", contacts.normal, contacts.force)
    ours = contacts.peak_force > 0
    np.add.at(total, contacts.frame[ours], normal[ours])
    peak = np.zeros(120)
    np.maximum.at(peak, contacts.frame, contacts.peak_force)
    assert (peak >= total - 1e-3).all()
    missed = (peak > 0) & (total == 0)
    assert missed.any(), "a bounce ended between two frames"
    assert peak.max() > 1.2 * total.max()


def test_shapes_stand_where_the_simulator_has_them(standing: tuple[World, Episode]) -> None:
    world, _ = standing
    put(world, soup_can=[0.5, 0.2, 0], small_bin=[0.5, -0.2, 0], lemon=[0.8, 0.4, 0])
    recorder = recorder_of(world)
    kept = {}

    def step(substep: int) -> None:
        kept.setdefault("geoms", world.data.geom_xpos.copy())
        kept.setdefault("tcp", world.data.site_xpos[world.tcp].copy())
        recorder.step(substep, STILL)

    world.act(STILL, step)
    episode = recorder.writer.episode()
    model = world.model
    solid = [g for g in range(model.ngeom) if model.geom_contype[g] or model.geom_conaffinity[g]]
    found = []
    for body in episode.header.bodies:
        track = episode.tracks[body.name]
        rotation = Rotation.from_quat(track.orientation[0], scalar_first=True)
        found += [rotation.apply(g.position) + track.position[0] for g in body.geoms]
        if body.tcp is not None:
            tcp = rotation.apply(body.tcp.position) + track.position[0]
            assert tcp == pytest.approx(kept["tcp"], abs=1e-6)
    assert np.array(found) == pytest.approx(kept["geoms"][solid], abs=1e-5)
