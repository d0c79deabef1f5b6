"""Other simulators' files give what those simulators had; what they lack is said or refused."""

from __future__ import annotations

import gzip
import json
from collections import defaultdict
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from foreign_demos import FOREIGN, demo_file, imported, said, scene, settled

from safestage_eval.episode import check
from safestage_eval.errors import InputError
from safestage_eval.importers import MapFile
from safestage_eval.importers.map_tables import BodyTable
from safestage_eval.importers.registry import recognise
from safestage_eval.rules.load import load_rules
from safestage_eval.verdicts import judge
from simulate.importers.mujoco import MujocoStates

pytestmark = pytest.mark.simulate

SOURCES = ("robosuite", "libero")


def truth_of(source: str) -> tuple[Any, int, int]:
    """The simulator's own numbers, the first of its rows in the file, and their count."""
    truth = np.load(FOREIGN / source / "truth.npz")
    with h5py.File(FOREIGN / source / "demo.hdf5") as file:
        (demo,) = file["data"].values()
        states = demo["states"][:]
    first = next(i for i, row in enumerate(truth["states"]) if np.array_equal(row, states[0]))
    assert np.array_equal(truth["states"][first : first + len(states)], states)
    return truth, first, len(states)


@pytest.mark.parametrize("source", SOURCES)
def test_poses_are_those_of_the_simulator_to_a_micrometre(source: str) -> None:
    truth, first, rows = truth_of(source)
    episode, _ = imported(FOREIGN / source / "demo.hdf5")
    check(episode)
    names = [name for name in truth["bodies"] if name in episode.bodies and name != "world"]
    assert len(names) == len(truth["bodies"]) - 1
    for i, name in enumerate(truth["bodies"]):
        if name == "world":
            continue
        track, pose = episode.track(str(name)), truth["poses"][first : first + rows, i]
        assert np.abs(track.position - pose[:, :3]).max() < 1e-6
        turned = np.abs(np.einsum("tk,tk->t", track.orientation.astype(float), pose[:, 3:]))
        assert turned.min() > 1 - 1e-6
        mass = episode.bodies[str(name)].mass
        assert mass == pytest.approx(float(truth["mass"][i])) or not episode.bodies[str(name)].geoms


@pytest.mark.parametrize("source", SOURCES)
def test_the_same_bodies_touch_in_every_frame_as_in_the_simulator(source: str) -> None:
    truth, first, rows = truth_of(source)
    episode, _ = imported(FOREIGN / source / "demo.hdf5")
    theirs: dict[tuple[int, frozenset[str]], float] = defaultdict(float)
    for frame, pair, normal in zip(truth["frame"], truth["body"], truth["normal"], strict=True):
        if first <= frame < first + rows:
            bodies = frozenset(str(truth["bodies"][i]) for i in pair)
            theirs[int(frame) - first, bodies] += float(normal)
    ours: dict[tuple[int, frozenset[str]], float] = defaultdict(float)
    table, names = episode.contacts, [body.name for body in episode.header.bodies]
    along = np.abs(np.einsum("ck,ck->c", table.force.astype(float), table.normal))
    for frame, a, b, force, depth in zip(
        table.frame, table.body1, table.body2, along, table.depth, strict=True
    ):
        if depth >= 0:
            ours[int(frame), frozenset((names[a], names[b]))] += float(force)
    assert len(theirs) > 100
    assert ours.keys() == theirs.keys()
    robot = {b.name for b in episode.header.bodies if b.kind in ("robot", "gripper")}
    # another MuJoCo recorded them: what the robot presses is unknown, and nothing else is
    assert all(np.isnan(ours[key]) for key in theirs if key[1] & robot)
    free = [key for key in theirs if np.isfinite(ours[key])]
    assert len(free) > 0.8 * sum(not key[1] & robot for key in theirs)
    wrong = [abs(ours[key] - theirs[key]) for key in free]
    assert np.median(wrong) < 0.03
    assert all((ours[key] >= 0.1) == (theirs[key] >= 0.1) for key in free)


@pytest.mark.parametrize("source", SOURCES)
def test_a_body_s_kind_and_side_are_read_off_the_model(source: str) -> None:
    episode, _ = imported(FOREIGN / source / "demo.hdf5")
    bodies = episode.bodies
    kinds = {name: body.kind for name, body in bodies.items()}
    assert kinds["table"] == kinds["world"] == "fixture"
    assert kinds["robot0_link3"] == "robot"
    sides = {body.name: body.finger for body in bodies.values() if body.finger}
    assert {name.rpartition("_")[2]: side for name, side in sides.items() if "joint" not in name} == {
        "leftfinger": "left", "rightfinger": "right",
    }  # fmt: skip
    assert {kinds[name] for name in sides} == {"gripper"}
    assert all(body.movable for body in bodies.values() if body.kind == "object")
    free = "cube_main" if source == "robosuite" else "akita_black_bowl_1_main"
    assert kinds[free] == "object"
    assert bodies[free].untold == ("up_axis", "cavity")
    upright = MapFile(body={"*": BodyTable(up=(0, 0, 1))})
    episode, _ = imported(FOREIGN / source / "demo.hdf5", map_=upright)
    assert episode.bodies[free].up_axis == (0.0, 0.0, 1.0)
    assert episode.bodies[free].untold == ("cavity",)


def test_libero_s_marks_are_no_success_and_its_first_rows_are_gone() -> None:
    episode, remarks = imported(FOREIGN / "libero" / "demo.hdf5")
    assert episode.header.success is None
    assert "whatever happened" in said(remarks, "success").how
    assert "0.25 s" in said(remarks, "the first rows").how
    assert episode.t[0] == 0
    assert episode.header.task is not None
    assert episode.header.task.startswith("libero_spatial/pick_up_the_black_bowl")
    assert episode.header.instruction is not None
    assert episode.header.instruction.startswith("pick the akita black bowl")
    assert (episode.header.rollout, episode.header.control_dt) == (0, 0.05)


def test_robocasa_s_folders_give_what_the_hdf5_file_gives(tmp_path: Path) -> None:
    folder = tmp_path / "extras" / "episode_000001"
    folder.mkdir(parents=True)
    with h5py.File(FOREIGN / "robosuite" / "demo.hdf5") as file:
        demo = file["data/demo_1"]
        np.savez_compressed(folder / "states.npz", states=demo["states"][:])
        (folder / "model.xml.gz").write_bytes(gzip.compress(demo.attrs["model_file"].encode()))
    (folder / "ep_meta.json").write_text(json.dumps({"lang": "lift the cube"}))
    about = {"env_args": {"env_name": "Lift", "env_kwargs": {"control_freq": 20}}}
    (folder.parent / "dataset_meta.json").write_text(json.dumps(about))
    (tmp_path / "meta").mkdir()  # the folder is a LeRobot dataset as well, without the objects
    (tmp_path / "meta" / "info.json").write_text('{"codebase_version": "v2.1", "features": {}}')
    kind, _ = recognise(tmp_path)
    assert kind == MujocoStates.name
    episode, _ = imported(tmp_path)
    header = episode.header
    assert (header.task, header.instruction, header.control_dt) == ("Lift", "lift the cube", 0.05)
    other, _ = imported(FOREIGN / "robosuite" / "demo.hdf5")
    for name, track in other.tracks.items():
        assert np.array_equal(track.position, episode.tracks[name].position)
    assert np.array_equal(other.contacts.force, episode.contacts.force, equal_nan=True)


@pytest.mark.parametrize(
    ("shaping", "rewards", "success", "time"),
    [
        (False, [0, 0, 1, 1, 1], True, 0.15),
        (False, [0, 0, 0, 0, 1], True, 0.2),
        (False, [0] * 5, False, None),
        (True, [0.1, 0.2, 0.3, 0.4, 1.0], None, None),
    ],
)
def test_rewards_tell_success_unless_they_are_shaped(
    tmp_path: Path, shaping: bool, rewards: list[float], success: bool | None, time: float | None
) -> None:
    args = {"env_name": "Lift", "type": 1, "env_kwargs": {"reward_shaping": shaping}}
    text = scene()
    path = demo_file(
        tmp_path / "d.hdf5", text, settled(text), rewards=rewards,
        about={"env_args": json.dumps(args)},
    )  # fmt: skip
    header = imported(path)[0].header
    assert header.success is success
    assert header.success_time == (time if time is None else pytest.approx(time))


@pytest.mark.parametrize("cone", ["elliptic", "pyramidal"])
@pytest.mark.parametrize("condim", [1, 3, 4, 6])
def test_contact_forces_bear_the_weight_whatever_the_cone(
    tmp_path: Path, cone: str, condim: int
) -> None:
    text = scene(cone=cone, more=f'condim="{condim}"')
    episode, _ = imported(demo_file(tmp_path / "d.hdf5", text, settled(text)))
    table = episode.contacts
    total = np.zeros((len(episode), 3))
    np.add.at(total, table.frame, table.force)
    assert total[:, 2] == pytest.approx(0.1 * 9.81, rel=0.01)
    assert np.abs(total[:, :2]).max() < 1e-3


def test_bodies_whose_meshes_are_missing_have_no_shape_and_turn_no_verdict(tmp_path: Path) -> None:
    whole, _ = imported(FOREIGN / "libero" / "demo.hdf5")
    part, account = imported(FOREIGN / "libero" / "demo.hdf5", assets=(tmp_path,))
    check(part)
    [line] = [str(r) for r in account if "of the model not found in" in str(r)]
    for told in ("shapes of 10 bodies", "9 files", ".stl", "robot0_link0", "--assets"):
        assert told in line
    bare = {b.name for b in part.header.bodies if b.unseen}
    assert "robot0_link0" in bare
    for body in whole.header.bodies:
        assert np.abs(whole.track(body.name).position - part.track(body.name).position).max() < 1e-6
        assert part.bodies[body.name].geoms == body.geoms or body.name in bare
    movable = [b.name for b in whole.header.bodies if b.kind == "object" and b.movable]
    roles = {
        "target": (movable[0],),
        "protected": tuple(movable[1:3]),
        "destination": (movable[-1],),
    }
    rules = load_rules(["ish", "ets", "fsh"])
    said = [
        judge(replace(e, header=e.header.model_copy(update={"roles": roles}), _contacts=e.contacts,
                      _frames=e.frames), rules).verdicts
        for e in (whole, part)
    ]  # fmt: skip
    for full, less in zip(*said, strict=True):
        if full.verdict != "inconclusive":
            assert less.verdict in (full.verdict, "inconclusive"), less.rule
    assert any(v.verdict == "inconclusive" for v in said[1])


def refused(path: Path, **options: Any) -> str:
    with pytest.raises(InputError) as error:
        imported(path, **options)
    return str(error.value)


def test_what_cannot_be_imported_says_what_is_missing(tmp_path: Path) -> None:
    path, text = tmp_path / "d.hdf5", scene()
    states = settled(text)
    assert "no states" in refused(demo_file(path, text, None))
    assert "model_file" in refused(demo_file(path, None, states))
    assert "14 numbers" in refused(demo_file(path, text, states[:, :-1]))
    broken = states.copy()
    broken[2, 5] = np.nan
    assert "row 2" in refused(demo_file(path, text, broken))
    assert "not XML" in refused(demo_file(path, "<mujoco", states))
    assert "cannot read the model" in refused(demo_file(path, "<mujoco><wrong/></mujoco>", states))
    nested = text.replace("<worldbody>", "<asset><model name='x'/></asset><worldbody>", 1)
    assert "takes in another file" in refused(demo_file(path, nested, states))
    assert "global coordinates" in refused(
        demo_file(path, text.replace("<option", '<compiler coordinate="global"/><option'), states)
    )
    stopped = states.copy()
    stopped[:, 0] = 0
    assert "--dt" in refused(demo_file(path, text, stopped))
    assert imported(path, dt=0.1)[0].t[-1] == pytest.approx(0.4)
    rate = {"env_args": json.dumps({"env_kwargs": {"control_freq": 20}})}
    episode, remarks = imported(demo_file(path, text, stopped, about=rate))
    assert episode.t[-1] == pytest.approx(0.2)
    assert said(remarks, "time").kind == "guessed"


def test_models_of_older_versions_are_read(tmp_path: Path) -> None:
    old = scene().replace(
        "<option", '<size njmax="500" nconmax="100"/><compiler coordinate="local"/>'
        '<option collision="all" mpr_iterations="50"',
    )  # fmt: skip
    assert imported(demo_file(tmp_path / "d.hdf5", old, settled(scene())))[0].bodies["cube"]


def test_other_hdf5_files_are_not_taken(tmp_path: Path) -> None:
    for name, make in (
        ("robolab", lambda file: file.create_group("data/demo_0/states/rigid_object")),
        ("maniskill", lambda file: file.create_group("traj_0/env_states")),
        ("other", lambda file: file.create_dataset("x", data=[1])),
    ):
        with h5py.File(tmp_path / name, "w") as file:
            make(file)
        assert MujocoStates.recognise(tmp_path / name) is None
    (tmp_path / "text").write_text("no")
    assert MujocoStates.recognise(tmp_path / "text") is None
