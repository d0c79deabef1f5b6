"""RLDS datasets: what they hold comes through, and what is damaged or hostile is reported in words."""

import json
from pathlib import Path

import numpy as np
import pytest
from exports import map_text
from rlds_sets import example, field, masked, record, steps_of, varint, write_rlds
from scenes import Scene
from studio import run

from safestage_eval.formats import discover, load


def scene(number=0, frames=20):
    s = Scene(frames, 10.0).fixed("table")
    path = np.linspace((0, 0, 0.02), (0.3, 0.1 * number, 0.02), frames)
    return s.box("cube", 0.02, path).episode(success=True, success_time=1.0)


def import_set(tmp_path, source, columns, *more):
    (tmp_path / "map.toml").write_text(map_text(scene(), success=True) + columns)
    return run("import", source, "--to", tmp_path / "data", "--map", tmp_path / "map.toml", *more)


def test_every_step_of_every_shard(tmp_path):
    ours = [scene(i, 20 + i) for i in range(5)]
    source, columns = write_rlds(tmp_path / "in", ours, shards=2)
    done = import_set(tmp_path, source, columns)
    assert done.code == 0, done.err
    assert len(discover(tmp_path / "data")) == 5
    for number, episode in enumerate(ours):
        theirs = load(tmp_path / "data", f"1.0.0/train_{number}")
        assert np.array_equal(theirs.track("cube").position, episode.track("cube").position)
        assert np.allclose(theirs.t, episode.t)
        assert theirs.header.instruction == "do it"
        assert theirs.header.rollout == number


def test_without_a_map_the_likely_columns_are_named(tmp_path):
    source, _ = write_rlds(tmp_path / "in", [scene()])
    done = run("import", source.parent, "--to", tmp_path / "data")
    assert done.code == 2
    assert "observation/sim_state" in done.err + done.text
    done = run("import", source, "--write-map", tmp_path / "new.toml")
    assert done.code == 0, done.err
    assert "observation/sim_state[0:14]" in (tmp_path / "new.toml").read_text()


def features_without_objects(folder, name):
    folder.mkdir(parents=True)
    (folder / "dataset_info.json").write_text(json.dumps({"name": name, "version": "1.0.0"}))
    inner = {"features": {"joint_position": {}, "exterior_image_1_left": {}}}
    steps = {"sequence": {"feature": {"featuresDict": inner}}}
    whole = {"featuresDict": {"features": {"steps": steps}}}
    (folder / "features.json").write_text(json.dumps(whole))


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("droid", "never measured"),
        ("aloha_mobile", "object tracker"),
        ("libero_spatial_no_noops", "data/demo_i/states"),
        ("bridge", "safestage-record"),
    ],
)
def test_sets_without_objects_say_why(tmp_path, name, told):
    features_without_objects(tmp_path / "tfds" / "1.0.0", name)
    done = run("import", tmp_path / "tfds", "--to", tmp_path / "data")
    assert done.code == 2
    for part in ("has no poses of objects", "joint_position", told):
        assert part in done.err + done.text
    assert not (tmp_path / "data").exists()


def shard(source):
    return next(source.glob("*.tfrecord-*"))


def claims(length):
    """A frame whose length is said to be so many bytes."""
    head = length.to_bytes(8, "little")
    return head + masked(head)


def columns_changed(change):
    columns = {f"steps/{key}": value for key, value in steps_of(scene()).items()}
    change(columns)
    return record(example(columns))


HOSTILE = {
    "cut off": (lambda whole: whole[:-7], "ends within this record"),
    "cut in the frame": (lambda whole: whole + b"\1\2\3", "ends within this record"),
    "a bit of the data": (
        lambda whole: whole[:99] + bytes([whole[99] ^ 4]) + whole[100:],
        "checksum",
    ),
    "a bit of the length": (
        lambda whole: bytes([whole[0] ^ 4]) + whole[1:],
        "not the length of a record",
    ),
    "a length beyond the file": (lambda whole: claims(2**62) + whole[12:], "ends within"),
    "compressed": (lambda whole: b"\x1f\x8b" + whole, "uncompressed"),
    "no example": (lambda whole: record(b"\xff" * 400), "is no tf.train.Example"),
    "a varint without end": (lambda whole: record(b"\x0a" + b"\x80" * 99), "is no tf.train.Exam"),
    "a message longer than it is": (
        lambda whole: record(b"\x0a" + varint(2**31) + b"x"),
        "is no tf.train.Example",
    ),
    "nested without end": (lambda whole: record(nested(5000)), "is no tf.train.Example"),
    "a column is gone": (
        lambda whole: columns_changed(lambda c: c.pop("steps/observation/twists")),
        "has no numbers in 'observation/twists'",
    ),
    "a column of texts": (
        lambda whole: columns_changed(
            lambda c: c.update({"steps/observation/twists": np.array(["a"])})
        ),
        "has no numbers in 'observation/twists'",
    ),
    "half a step": (
        lambda whole: columns_changed(
            lambda c: c.update({"steps/observation/twists": np.zeros(13, np.float32)})
        ),
        "a multiple of 12",
    ),
    "fewer steps in a column": (
        lambda whole: columns_changed(
            lambda c: c.update({"steps/observation/twists": np.zeros((3, 12), np.float32)})
        ),
        "different numbers of steps",
    ),
    "no steps": (
        lambda whole: columns_changed(
            lambda c: c.update({k: v[:0] for k, v in c.items() if "instr" not in k})
        ),
        "numbers of steps, or none",
    ),
}


def nested(depth):
    data = b""
    for _ in range(depth):
        data = field(1, data)
    return data


@pytest.mark.parametrize("what", HOSTILE)
def test_hostile_records_are_reported(tmp_path, what):
    change, message = HOSTILE[what]
    source, columns = write_rlds(tmp_path / "in", [scene()])
    shard(source).write_bytes(change(shard(source).read_bytes()))
    done = import_set(tmp_path, source, columns)
    assert done.code != 0
    assert message in " ".join((done.err + done.text).split()), done.err
    assert "Traceback" not in done.err + done.text
    assert "bug in" not in done.err + done.text


def test_limits_hold(tmp_path, monkeypatch):
    monkeypatch.setenv("SAFESTAGE_LIMITS", "frames=10")
    source, columns = write_rlds(tmp_path / "in", [scene()])
    done = import_set(tmp_path, source, columns)
    assert done.code != 0
    assert "--limits frames=20" in done.err + done.text


def test_files_of_other_kinds_are_reported(tmp_path):
    source, columns = write_rlds(tmp_path / "in", [scene()])
    old = shard(source)
    old.rename(old.with_name(old.name.replace("tfrecord", "array_record")))
    done = import_set(tmp_path, source, columns)
    assert done.code == 2
    assert "array_record" in done.err and "tfds convert_format" in done.err


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("observation/twists", "observation/speeds", "is no column of numbers"),
        ("observation/twists", "language_instruction", "is no column of numbers"),
        ("sim_state[3:7]", "sim_state[3:6]", "4 numbers"),
        ('quaternion = "xyzw"', "", "prescribes none"),
    ],
)
def test_mistakes_in_the_map_are_reported(tmp_path, old, new, told):
    source, columns = write_rlds(tmp_path / "in", [scene()])
    done = import_set(tmp_path, source, columns.replace(old, new))
    assert done.code == 2
    assert told in done.err


THEIRS = Path(__file__).parent / "foreign" / "rlds"
THEIR_MAP = """
[source]
quaternion = "xyzw"
dt = 0.1
[columns]
success = "reward"
joint_position = "observation/state"
[columns.body.cube]
position = "observation/cube_pose[0:3]"
orientation = "observation/cube_pose[3:7]"
[body.cube]
shapes = [{ kind = "box", size = [0.02, 0.02, 0.02] }]
[body.table]
position = [0, 0, -0.02]
shapes = [{ kind = "box", size = [1, 1, 0.02] }]
"""


def test_what_tensorflow_datasets_wrote_itself(tmp_path):
    """With images, tensors of two axes and float64, and two splits."""
    (tmp_path / "map.toml").write_text(THEIR_MAP)
    done = run("import", THEIRS, "--to", tmp_path / "data", "--map", tmp_path / "map.toml")
    assert done.code == 0, done.err
    for name, frames, way in (("train_0", 8, 0.1), ("train_1", 9, 0.2), ("val_0", 8, 0.1)):
        episode = load(tmp_path / "data", f"rlds/{name}")
        x = episode.track("cube").position[:, 0]
        assert x == pytest.approx(np.linspace(0, way, frames), abs=1e-7)
        assert episode.header.success_time == pytest.approx(0.1 * (frames - 2))
        assert episode.header.instruction == "push the cube"
