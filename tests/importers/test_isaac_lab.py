"""RoboLab's and Isaac Lab's layout, with its quirks."""

import json

import numpy as np
import pytest
from exports import com_twist, map_text, write_robolab
from scenes import Scene
from studio import run

from safestage_eval.episode import Body, Geom
from safestage_eval.formats import load
from safestage_eval.geometry.pose import rotate
from safestage_eval.importers.bind_headers import load_bound
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
        ({"version": None}, (), ("no isaaclab_version", "--quaternion")),
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


def test_a_standard_task_needs_no_map(tmp_path):
    """Isaac Lab's recorder writes neither shapes nor the time between rows; its stacking task has them."""
    s = Scene(FRAMES, RATE).fixed("table", (0.4, 0, 0))
    for i in (1, 2, 3):
        s.box(f"cube_{i}", 0.0234, (0.3, 0.2 * i, 0.0234))
    task = "Isaac-Stack-Cube-Franka-IK-Rel-Mimic-v0"
    source = write_robolab(
        tmp_path / "out", [s.episode(task=task)], beside=False, results=False, boxes=False
    )
    done = take(source, tmp_path / "data")
    assert done.code == 0, done.err
    episode = load(tmp_path / "data")
    assert np.allclose(np.diff(episode.t), 0.05)
    assert episode.header.physics_dt == 0.01
    for i in (1, 2, 3):
        assert episode.bodies[f"cube_{i}"].geoms[0].size == pytest.approx((0.0234,) * 3)
    for told in ("guessed: time between rows", "guessed: the shape of cube_1"):
        assert told in done.text


def tower(falls):
    """Two cubes set down on a third in 2 s; one falls off a second later, or stays."""
    s = Scene(80, 20.0).fixed("table", (0.4, 0, 0))
    cube = Geom(kind="box", size=(0.0234,) * 3)
    for i in (1, 2, 3):
        done = np.clip((s.t - 0.5 * i) / 0.5, 0, 1)[:, None]
        begin, end = (0.3, 0.15 * i, 0.0234), (0.3, 0.15, 0.0234 + 0.0468 * (i - 1))
        lifted = np.sin(np.pi * done) * (0, 0, 0.2 * (i > 1))
        path = begin + (np.array(end) - begin) * done + lifted
        if falls and i == 3:
            path[60:] = (0.3, 0.3, 0.0234)
        s.body(f"cube_{i}", cube, path, turned(np.zeros(80)))
    task = "Isaac-Stack-Cube-Franka-IK-Rel-Mimic-v0"
    return s.episode(task=task, success=True, success_time=float(s.t[-1]))


def test_a_success_whose_tower_has_fallen_is_named(tmp_path):
    source = write_robolab(
        tmp_path / "out", [tower(False), tower(True)], beside=False, results=False, boxes=False
    )
    bind = builtin_folder() / "bind" / "isaaclab.toml"
    done = take(source, tmp_path / "data", "--bind", bind)
    assert done.code == 0, done.err
    assert "guessed: the moment of success" in done.text
    found = json.loads(run("audit", tmp_path / "data", "--format", "json").text)["findings"]
    lost = [each for each in found if each["code"] == "AUD315"]
    assert len(lost) == 1
    assert "run_0/demo_1" in json.dumps(lost[0])


@pytest.mark.parametrize(
    ("goal", "told"),
    [
        ('"onn"', "no goal 'onn' is loaded"),
        ('{ roles = { target = "object" }, require = { "suported(target)" = true } }', "suported"),
        ('"on"', None),
    ],
)
def test_a_goal_of_the_map_is_used_or_refused(tmp_path, goal, told):
    source = write_robolab(tmp_path / "out", [scene()])
    (tmp_path / "map.toml").write_text(f"[every]\ngoal = {goal}\n")
    done = take(source, tmp_path / "data", "--map", tmp_path / "map.toml")
    assert done.code == (0 if told is None else 2)
    if told is None:
        assert load(tmp_path / "data").header.goal == "on"
    else:
        assert told in done.err and "[every] goal" in done.err


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
