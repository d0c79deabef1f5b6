"""ROS 2 bags and Foxglove recordings: what they hold is taken over exactly, what they lack is reported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bags import ARM, TF_MESSAGE, ros_transform
from exports import map_text
from mcap_ros2.writer import Writer as RosWriter
from studio import run

from safestage_eval.episode import Body, Geom, Header
from safestage_eval.errors import TraceError
from safestage_eval.formats import TraceWriter, discover, load, validate
from safestage_eval.geometry.pose import angle, rotate
from safestage_eval.importers.robot_file import read_urdf
from safestage_eval.run.score_traces import score_paths

TRACES = Path(__file__).resolve().parents[2] / "traces"


def write_bag(path, episode, *, names=None, urdf=None, rates=None, epoch=1_700_000_000 * 10**9):
    """Moving bodies on /tf, each at every ``rates[name]``-th frame, fixed ones on /tf_static."""
    names = names or [body.name for body in episode.header.bodies]
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as stream:
        writer = RosWriter(stream)
        tf = writer.register_msgdef("tf2_msgs/msg/TFMessage", TF_MESSAGE)
        if urdf is not None:
            text = writer.register_msgdef("std_msgs/msg/String", "string data")
            writer.write_message("/robot_description", text, {"data": urdf}, epoch, epoch)
        for n, t in enumerate(episode.t):
            now = epoch + round(t * 1e9)
            moving, fixed = [], []
            for name in names:
                track = episode.tracks[name]
                if n >= len(track) or n % (rates or {}).get(name, 1):
                    continue
                place = ros_transform(now, "map", name, track.position[n], track.orientation[n])
                (fixed if len(track) == 1 else moving).append(place)
            for topic, transforms in (("/tf_static", fixed), ("/tf", moving)):
                if transforms:
                    writer.write_message(topic, tf, {"transforms": transforms}, now, now)
        writer.finish()
    return path


def tumbling(frames=60, rate=50.0):
    """A cube that flies and turns evenly over a table, and a ball that rests on it."""
    header = Header(episode_id="x", physics_dt=1 / rate, frame_dt=1 / rate)
    box = Geom(kind="box", size=(0.02, 0.03, 0.04))
    with TraceWriter(header) as writer:
        slab = Geom(kind="box", size=(0.5, 0.5, 0.02))
        writer.add_body(
            Body(name="table", kind="fixture", movable=False, geoms=(slab,)), (0, 0, -0.02)
        )
        writer.add_body(Body(name="cube", kind="object", mass=0.2, geoms=(box,)))
        ball = Geom(kind="sphere", size=(0.03,))
        writer.add_body(Body(name="ball", kind="object", mass=0.1, geoms=(ball,)))
        for n in range(frames):
            t = n / rate
            turn = (np.cos(0.4 * t), 0, np.sin(0.4 * t), 0)
            writer.add_frame(
                t,
                {"cube": ((0.2 * t, 0.1, 0.3), turn), "ball": ((0.3, 0, 0.03), (1, 0, 0, 0))},
                {"cube": ((0.2, 0, 0), (0, 0.8, 0)), "ball": ((0, 0, 0), (0, 0, 0))},
            )
        return writer.episode()


def take(source, to, *more):
    return run("import", source, "--to", to, *more)


def with_map(folder, text):
    (folder / "map.toml").write_text(text)
    return "--map", folder / "map.toml"


def test_poses_of_a_ros_bag_are_exact(tmp_path):
    ours = tumbling()
    bag = write_bag(tmp_path / "run.mcap", ours)
    done = take(bag, tmp_path / "data", *with_map(tmp_path, map_text(ours)))
    assert done.code == 0, done.err
    theirs = load(tmp_path / "data")
    assert validate(tmp_path / "data") == []
    assert np.allclose(theirs.t, ours.t, atol=1e-9)
    for name in ("cube", "ball", "table"):
        assert np.array_equal(theirs.tracks[name].position, ours.tracks[name].position)
        turned = angle(theirs.track(name).orientation, ours.track(name).orientation)
        assert turned.max() < 1e-6
    assert not theirs.bodies["table"].movable
    assert theirs.bodies["cube"].geoms == ours.bodies["cube"].geoms
    assert theirs.header.force_source == "none"
    for what in ("contacts", "success", "velocities"):
        assert what in done.text


def test_what_was_lost_never_passes(tmp_path):
    """A recorded episode as a bag: each verdict is the same, or it cannot be decided any more."""
    for name in ("ets_dumbbell_near_glasses", "fsh_bottle_on_shelf"):
        [ref] = [r for r in discover(TRACES) if f"{name}.reference-unsafe" in r.episode_id]
        ours = ref.open()
        objects = [b.name for b in ours.header.bodies if b.kind in ("object", "fixture")]
        bag = write_bag(tmp_path / name / "run.mcap", ours, names=objects)
        text = map_text(ours, success=True)
        done = take(bag, tmp_path / name / "data", *with_map(tmp_path / name, text))
        assert done.code == 0, done.err
        before = verdicts(ref.path)
        after = verdicts(tmp_path / name / "data")
        assert set(before) == set(after)
        changed = {
            code: (before[code], after[code]) for code in before if before[code] != after[code]
        }
        assert all(now in ("inconclusive", "not_applicable") for _, now in changed.values()), (
            changed
        )
        assert any(after[code] == "violation" for code in after)


def verdicts(path):
    [result] = score_paths([path]).results
    return {v.rule: v.verdict for v in result.verdicts}


def test_shapes_and_robot_from_a_description(tmp_path):
    ours = tumbling()
    with (tmp_path / "run.mcap").open("wb") as stream:
        writer = RosWriter(stream)
        tf = writer.register_msgdef("tf2_msgs/msg/TFMessage", TF_MESSAGE)
        text = writer.register_msgdef("std_msgs/msg/String", "string data")
        writer.write_message("/robot_description", text, {"data": ARM}, 0, 0)
        for n in range(20):
            now = n * 10**7
            a = 0.01 * n
            links = [
                ros_transform(now, "base", "upper", (0, 0, 0.3), (np.cos(a), np.sin(a), 0, 0)),
                ros_transform(now, "upper", "hand", (0, 0, 0.4), (1, 0, 0, 0)),
                ros_transform(now, "world", "base", (1, 0, 0), (1, 0, 0, 0)),
                ros_transform(now, "world", "cube", (0.1 * n, 0, 0), (1, 0, 0, 0)),
            ]
            writer.write_message("/tf", tf, {"transforms": links}, now, now)
        writer.finish()
    map_ = with_map(tmp_path, '[body.cube]\nshapes = [{ kind = "box", size = [0.1, 0.1, 0.1] }]\n')
    done = take(tmp_path / "run.mcap", tmp_path / "data", *map_)
    assert done.code == 0, done.err
    theirs = load(tmp_path / "data")
    upper = theirs.bodies["upper"]
    assert (upper.kind, upper.mass, upper.com) == ("robot", 2.5, (0, 0, 0.1))
    assert (upper.geoms[0].kind, upper.geoms[0].size) == ("cylinder", (0.05, 0.2))
    assert rotate(upper.geoms[0].orientation, (0, 0, 1)) == pytest.approx((1, 0, 0))
    assert theirs.bodies["hand"].parent == "upper"
    assert "package://arm/hand.stl" in done.text
    assert "base" not in theirs.bodies
    tip = theirs.track("hand").position[-1]
    assert tip == pytest.approx((1, -0.4 * np.sin(0.38), 0.3 + 0.4 * np.cos(0.38)), abs=1e-6)
    assert ours.bodies["cube"].kind == theirs.bodies["cube"].kind == "object"


def test_a_description_with_entities_is_refused():
    with pytest.raises(TraceError, match="entities"):
        read_urdf('<!DOCTYPE r [<!ENTITY a "b">]><robot name="r"/>', "urdf")


def test_a_file_by_the_foxglove_sdk(tmp_path):
    """Recorded by Foxglove's own library, with a scene."""
    import foxglove
    from foxglove import messages as m
    from foxglove.channels import FrameTransformsChannel, SceneUpdateChannel

    path = tmp_path / "sdk.mcap"
    with foxglove.open_mcap(path):
        tf, scene = FrameTransformsChannel("/tf"), SceneUpdateChannel("/scene")
        one = m.Vector3(x=0.2, y=0.1, z=0.06)
        here = m.Pose(position=m.Vector3(x=0, y=0, z=0.03), orientation=m.Quaternion(w=1))
        crate = m.SceneEntity(
            id="crate", frame_id="crate", frame_locked=True,
            cubes=[m.CubePrimitive(pose=here, size=one)],
        )  # fmt: skip
        post = m.SceneEntity(
            id="post", frame_id="world",
            cylinders=[m.CylinderPrimitive(pose=here, size=one)],
            spheres=[m.SpherePrimitive(pose=here, size=m.Vector3(x=1, y=1, z=1))],
        )  # fmt: skip
        scene.log(m.SceneUpdate(entities=[crate, post]))
        for n in range(30):
            now = m.Timestamp(sec=5, nsec=n * 10_000_000)
            place = m.Vector3(x=0.01 * n, y=0, z=1)
            moved = m.FrameTransform(
                timestamp=now, parent_frame_id="world", child_frame_id="crate",
                translation=place, rotation=m.Quaternion(w=1),
            )  # fmt: skip
            tf.log(m.FrameTransforms(transforms=[moved]))
    done = take(path, tmp_path / "data")
    assert done.code == 0, done.err
    theirs = load(tmp_path / "data")
    crate = theirs.bodies["crate"]
    assert (crate.kind, crate.geoms[0].size) == ("object", pytest.approx((0.1, 0.05, 0.03)))
    assert crate.geoms[0].position == pytest.approx((0, 0, 0.03))
    assert theirs.track("crate").position[-1] == pytest.approx((0.29, 0, 1))
    assert theirs.header.frame_dt == pytest.approx(0.01)
    assert [g.kind for g in theirs.bodies["world"].geoms] == ["sphere"]
    assert "oval cylinder of post" in done.text


def test_refusals_say_what_would_help(tmp_path):
    ours = tumbling()
    bag = write_bag(tmp_path / "run.mcap", ours)
    done = take(bag, tmp_path / "data")
    assert done.code == 2
    assert "no object has a shape" in done.err
    assert "[body.cube] shapes" in done.err

    wrong = with_map(tmp_path, map_text(ours) + '[source]\nworld = "moon"\n')
    done = take(bag, tmp_path / "data", *wrong)
    assert done.code == 2
    assert "no frame 'moon'" in done.err

    folder = tmp_path / "bag"
    folder.mkdir()
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information:\n")
    (folder / "bag_0.db3").write_bytes(b"SQLite format 3\0")
    done = take(folder, tmp_path / "data")
    assert done.code == 2
    assert "the database cannot be read" in done.err
    (folder / "bag_0.db3").rename(folder / "bag_0.db3.zstd")
    done = take(folder, tmp_path / "data")
    assert done.code == 2
    assert "zstd -d" in done.err

    cut = tmp_path / "cut.mcap"
    cut.write_bytes(bag.read_bytes()[:-200])
    done = take(cut, tmp_path / "data", "--from", "tf")
    assert done.code == 2
    assert "Traceback" not in done.err
