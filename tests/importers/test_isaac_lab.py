"""RoboLab's and Isaac Lab's layout, with its quirks."""

import json
import re

import h5py
import numpy as np
import pytest
from exports import com_twist, map_text, write_robolab
from scenes import Scene
from studio import run

from safestage_eval.episode import Body, Geom
from safestage_eval.formats import load
from safestage_eval.geometry.pose import rotate
from safestage_eval.importers import box_fit
from safestage_eval.importers.bind_headers import load_bound
from safestage_eval.importers.isaac_file import order_of
from safestage_eval.rules.files import builtin_folder

FRAMES, RATE = 40, 15.0


def turned(angle, axis=(0, 0, 1)):
    half = np.asarray(angle)[:, None] / 2
    return np.hstack([np.cos(half), np.sin(half) * np.asarray(axis, float)])


def scene(success=True):
    """A cube that slides and turns, a can-sized box at rest, a table, a hand over them."""
    s = Scene(FRAMES, RATE).fixed("table", (0.4, 0, 0.05))
    path = np.column_stack(
        [np.linspace(0.3, 0.6, FRAMES), np.full(FRAMES, -0.2), np.full(FRAMES, 0.08)]
    )
    spin = turned(np.linspace(0, 2, FRAMES))
    s.body("cube", Geom(kind="box", size=(0.03, 0.03, 0.03), position=(0, 0, 0.0)), path, spin)
    s.box("carton", (0.02, 0.03, 0.05), (0.4, 0.25, 0.1004), com=(0, 0, -0.02))
    s.bodies[-2] = s.bodies[-2].model_copy(update={"com": (0.01, 0, 0)})
    omega = 2 / ((FRAMES - 1) / RATE)
    s.tracks["cube"].angular_velocity[:, 2] = omega
    hand = np.column_stack([path[:, :2], np.full(FRAMES, 0.3)])
    s.bodies.append(Body(name="hand", kind="gripper"))
    s.tracks["hand"] = s.tracks["cube"].__class__(
        hand.astype("f4"), s.tracks["cube"].orientation, s.tracks["cube"].linear_velocity,
        s.tracks["cube"].angular_velocity,
    )  # fmt: skip
    fields = {"success": success, "success_time": (FRAMES - 1) / RATE if success else None}
    return s.episode(task="SlideTask", roles={"target": ("cube",)}, **fields)


def take(source, to, *more):
    return run("import", source, "--to", to, *more)


def account(text, kind):
    return [line for line in text.splitlines() if re.search(rf"  {kind}: ", line)]


@pytest.mark.parametrize(
    ("version", "order"),
    [("2.3.2.post1", "wxyz"), ("0.46.3", "wxyz"), ("3.0.0", "xyzw"), ("4.6.6", "xyzw")],
)
def test_poses_and_velocities_of_either_order(tmp_path, version, order):
    ours = scene()
    source = write_robolab(tmp_path / "out", [ours], version=version, order=order)
    (tmp_path / "map.toml").write_text(map_text(ours))
    done = take(source, tmp_path / "data", "--map", tmp_path / "map.toml")
    assert done.code == 0, done.err
    theirs = load(tmp_path / "data", "run_0/demo_0")
    assert len(theirs) == len(ours)
    assert np.allclose(theirs.t, ours.t, atol=1e-12)
    for name in ("cube", "carton"):
        a, b = theirs.track(name), ours.track(name)
        assert np.array_equal(a.position, b.position)
        assert np.allclose(a.orientation, b.orientation, atol=1e-7)
        assert np.allclose(a.linear_velocity, b.linear_velocity, atol=1e-6)
        assert np.array_equal(a.angular_velocity, b.angular_velocity)
    assert not theirs.bodies["table"].movable
    header = theirs.header
    assert (header.task, header.policy, header.prompt) == ("SlideTask", "pi05", "default")
    assert (header.success, header.termination) == (True, "success")
    assert header.success_time == pytest.approx(ours.t[-1])
    assert (header.frame_dt, header.physics_dt) == pytest.approx((1 / RATE, 1 / RATE / 8))
    assert (header.seed, header.horizon, header.force_source) == (3, 60, "none")
    assert theirs.bodies["cube"].geoms == ours.bodies["cube"].geoms


def test_roles_come_from_the_success_condition_or_a_bind_file(tmp_path):
    source = write_robolab(tmp_path / "out", [scene()])
    assert take(source, tmp_path / "data").code == 0
    roles = {"target": ("cube",), "destination": ("carton",)}
    assert load(tmp_path / "data").header.roles == roles
    bind = tmp_path / "bind.toml"
    bind.write_text('[task.SlideTask]\nroles = { target = "carton", protected = "cube" }\n')
    assert take(source, tmp_path / "bound", "--bind", bind).code == 0
    bound = {"target": ("carton",), "destination": ("carton",), "protected": ("cube",)}
    assert load(tmp_path / "bound").header.roles == bound


def test_the_tasks_of_the_benchmark_have_roles():
    path = builtin_folder() / "bind" / "robolab.toml"
    bound = load_bound(path)
    assert len(bound.task) == 120
    header = scene().header.model_copy(update={"task": "BagelsOnPlateTask", "roles": {}})
    assert bound.onto(header, "demo_0").roles == {
        "target": ("bagel_00", "bagel_06"),
        "destination": ("plate_large",),
        "protected": ("banana", "bowl"),
    }
    for table in bound.task.values():
        players = [name for role in table["roles"].values() for name in role]
        assert len(players) == len(set(players))  # nobody plays two roles


def test_frames_and_actions_belong_together(tmp_path):
    """One more frame than actions; row i is in force from frame i on, the last one stays."""
    source = write_robolab(tmp_path / "out", [scene()])
    assert take(source, tmp_path / "data").code == 0
    theirs = load(tmp_path / "data")
    expected = [*range(FRAMES - 1), FRAMES - 2]
    assert theirs.frames.action[:, 0].tolist() == expected
    closed = np.linspace(0, 1, FRAMES)
    assert np.allclose(theirs.frames.gripper[:, 0], 1 - closed, atol=1e-6)
    assert theirs.frames.joint_position.shape == (FRAMES, 13)


def test_without_a_map_shapes_are_the_boxes_and_the_rest_is_said(tmp_path):
    source = write_robolab(tmp_path / "out", [scene()])
    done = take(source, tmp_path / "data")
    assert done.code == 0, done.err
    theirs = load(tmp_path / "data")
    cube, carton = (theirs.bodies[name].geoms[0] for name in ("cube", "carton"))
    assert cube.size == pytest.approx((0.03,) * 3, abs=2e-4)  # it turns: rounding averages out
    assert carton.size == pytest.approx((0.02, 0.03, 0.05), abs=1e-3)
    assert carton.position == pytest.approx((0, 0, 0), abs=6e-4)
    assert theirs.bodies["carton"].untold == ("up_axis", "cavity")
    text = "\n".join(account(done.text, "missing"))
    for what in ("masses", "up axes", "insides of containers", "contacts", "the time after success",
                 "poses of the links of robot", "shapes of the gripper"):  # fmt: skip
        assert what in text
    guessed = "\n".join(account(done.text, "guessed"))
    for what in ("shapes of carton, cube, table", "table is a fixture", "centres of mass"):
        assert what in guessed


def test_velocities_are_moved_from_the_centre_of_mass(tmp_path):
    """Without a map the centre is the middle of the box, and its velocity is what was recorded."""
    ours = scene()
    source = write_robolab(tmp_path / "out", [ours])
    assert take(source, tmp_path / "data").code == 0
    theirs = load(tmp_path / "data")
    recorded = com_twist(ours, ours.bodies["cube"])[:, :3]
    body, track = theirs.bodies["cube"], theirs.track("cube")
    arm = rotate(track.orientation, np.array(body.com))
    assert np.allclose(
        track.linear_velocity + np.cross(track.angular_velocity, arm), recorded, atol=1e-6
    )


@pytest.mark.parametrize(
    ("written", "more", "told"),
    [
        ({"version": None}, (), ("no isaaclab_version", "--quaternion", "look like wxyz")),
        ({"version": "1.2.0"}, (), ("isaaclab_version is 1.2.0", "--quaternion")),
        ({"beside": False, "results": False}, (), ("time between its rows", "env_cfg.json", "--dt")),
        ({"boxes": False}, (), ("no object has a shape (carton, cube)", "--map FILE", "[body.carton]")),
        ({}, ("--quaternion", "xyzw"), ("read as wxyz they do not", "--quaternion wxyz")),
        ({"version": "3.0.0"}, (), ("read as xyzw", "--quaternion wxyz")),
    ],
)  # fmt: skip
def test_what_is_refused_and_what_would_mend_it(tmp_path, written, more, told):
    source = write_robolab(tmp_path / "out", [scene()], **written)
    done = take(source, tmp_path / "data", *more)
    assert done.code == 2
    for part in told:
        assert part in done.err
    assert "Traceback" not in done.err


@pytest.mark.parametrize(
    ("written", "more"),
    [
        ({"version": None}, ("--quaternion", "wxyz")),
        ({"beside": False, "results": False}, ("--dt", "1/15")),
    ],
)
def test_what_was_refused_is_taken_with_what_it_lacked(tmp_path, written, more):
    source = write_robolab(tmp_path / "out", [scene()], **written)
    assert take(source, tmp_path / "data", *more).code == 0


def test_a_recording_without_states(tmp_path):
    source = write_robolab(tmp_path / "out", [scene()])
    with h5py.File(source, "a") as file:
        del file["data/demo_0/states"]
    done = take(source, tmp_path / "data")
    assert done.code == 2
    assert "PostStepStatesRecorder" in done.err


def test_a_damaged_file_among_sound_ones(tmp_path):
    source = write_robolab(tmp_path / "out", [scene(), scene(success=False)])
    whole = source.read_bytes()
    (source.parent / "run_1.hdf5").write_bytes(whole[: len(whole) // 2])
    done = take(tmp_path / "out", tmp_path / "data", "--jobs", "2")
    assert done.code == 2
    assert "run_1.hdf5: cannot be read" in done.err
    assert "2 imported" in done.err
    failed = load(tmp_path / "data", "out/SlideTask/run_0/demo_1").header
    assert (failed.success, failed.success_time, failed.rollout) == (False, None, 1)


def test_success_that_is_nowhere_is_not_known(tmp_path):
    source = write_robolab(tmp_path / "out", [scene()], results=False)
    with h5py.File(source, "a") as file:
        del file["data/demo_0"].attrs["success"]
    assert "missing: success" in take(source, tmp_path / "data").text
    assert load(tmp_path / "data").header.success is None


def test_broken_side_files_are_reported(tmp_path):
    source = write_robolab(tmp_path / "out", [scene()])
    (source.parent / "env_cfg.json").write_text('{"sim": ')
    done = take(source, tmp_path / "data")
    assert done.code == 0, done.err  # dt is in the results as well
    assert "env_cfg.json" in "\n".join(account(done.text, "missing"))
    assert json.loads(run("inspect", tmp_path / "data", "--json").text)["gravity"] == [0, 0, -9.81]


def test_orders_by_version():
    known = {"0.30.1": "wxyz", "2.0.0": "wxyz", "2.3": "wxyz", "3.0.0b2": "xyzw", "6.0.0": "xyzw"}
    assert {version: order_of(version) for version in known} == known
    assert [order_of(v) for v in ("1.0.0", "2.4.0", "main")] == [None] * 3


def test_a_box_that_stands_askew_in_its_body():
    tilted = (np.cos(0.3), np.sin(0.3), 0.0, 0.0)
    signs = np.array([[1 if i >> k & 1 else -1 for k in range(3)] for i in range(8)])
    inner = rotate(tilted, signs * (0.05, 0.08, 0.11)) + np.array([0.01, 0.02, 0.03])
    spin = turned(np.linspace(0, 3, 200), (0.6, 0, 0.8))
    world = rotate(np.repeat(spin, 8, axis=0), np.tile(inner, (200, 1))).reshape(-1, 8, 3)
    place = np.linspace((0.3, -0.2, 0.4), (0.7, 0.5, 0.1), 200)
    found = box_fit.fit(
        box_fit.to_metres(np.trunc((world + place[:, None]) * 1e3).astype("i2")), place, spin
    )
    assert found.geom.size == pytest.approx((0.05, 0.08, 0.11), abs=2e-4)
    assert found.geom.position == pytest.approx((0.01, 0.02, 0.03), abs=2e-4)
    again = rotate(found.geom.orientation, signs * found.geom.size) + np.array(found.geom.position)
    assert np.abs(again - inner).max() < 5e-4
    assert found.spread < 1.2e-3
