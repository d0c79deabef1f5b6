"""Recordings of joints alone: every kind of file, and answers that trigonometry knows."""

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from studio import run

from safestage_eval import load
from safestage_eval.rules.files import builtin_folder
from safestage_eval.rules.load import load_rules
from safestage_eval.verdicts import judge

ARM = """<robot name="two"><link name="base"><collision><geometry><box size="0.1 0.1 0.2"/></geometry></collision></link>
<link name="upper"><collision><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.03" length="0.4"/></geometry>
</collision></link>
<link name="fore"><collision><origin xyz="0 0 0.16"/><geometry><sphere radius="0.03"/></geometry></collision></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.1"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2"/></joint>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 0.4"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3"/></joint></robot>"""
TABLE = """[body.table]
kind = "fixture"
position = [0, 0, -0.1]
shapes = [{ kind = "plane" }]
"""
T = np.arange(240) / 30


def motion(shoulder=0.0, elbow=0.0):
    """(T, 2) rad: both joints swing to these angles and back within 8 s, and never stop for long."""
    return np.outer(np.sin(T * np.pi / 8) ** 2, [shoulder, elbow])


def csv(path, rows, t=T, names=("shoulder.pos", "elbow.pos"), time="timestamp"):
    lines = [",".join((time, *names))]
    lines += [",".join(map(repr, map(float, (at, *row)))) for at, row in zip(t, rows, strict=True)]
    path.write_text("\n".join(lines))
    return path


def npz(path, rows):
    np.savez(path, joint_position=rows, time=T)
    return path


def parquet(path, rows):
    columns = {"timestamp": pa.array(T), "q": pa.array(list(rows)), "action": pa.array(list(rows))}
    pq.write_table(pa.table(columns), path)
    return path


def droid(path, rows):
    with h5py.File(path, "w") as file:
        file["observation/robot_state/joint_positions"] = rows
        file["observation/robot_state/cartesian_position"] = np.zeros((len(rows), 6))
        file["action/joint_position"] = rows + 1
        file["observation/timestamp"] = T
    return path


def judged(tmp_path, source, map_=TABLE):
    """Code → verdict of the rules of ``robot``, and the episode."""
    (tmp_path / "two.urdf").write_text(ARM)
    (tmp_path / "map.toml").write_text(map_)
    done = run(
        "import", source, "--to", tmp_path / source.stem, "--robot", tmp_path / "two.urdf",
        "--map", tmp_path / "map.toml",
    )  # fmt: skip
    assert done.code == 0, done.err
    episode = load(tmp_path / source.stem)
    return verdicts(episode), episode


def verdicts(episode):
    return {v.rule: v for v in judge(episode, load_rules(["robot"])).verdicts}


MAKERS = {"a.csv": csv, "a.npz": npz, "a.parquet": parquet, "trajectory.h5": droid}


@pytest.mark.parametrize("name", MAKERS)
def test_every_kind_of_file_is_the_same_motion(tmp_path, name):
    rows = motion(1.0, 1.2)
    _, episode = judged(tmp_path, MAKERS[name](tmp_path / name, rows))
    assert np.allclose(episode.t, T)
    assert np.allclose(episode.frames.joint_position, rows, atol=1e-6)
    assert [joint.name for joint in episode.header.joints] == ["shoulder", "elbow"]
    bend = rows.sum(axis=1)
    tip = 0.4 * np.sin(rows[:, 0]), 0.1 + 0.4 * np.cos(rows[:, 0])
    assert np.allclose(episode.track("fore").position[:, [0, 2]], np.transpose(tip), atol=1e-6)
    assert np.allclose(
        np.abs(episode.track("fore").orientation[:, 0]), np.abs(np.cos(bend / 2)), atol=1e-6
    )


def test_a_quiet_motion_passes_all_that_applies(tmp_path):
    found, _ = judged(tmp_path, csv(tmp_path / "a.csv", motion(1.0, 1.2)))
    assert {code: f.verdict for code, f in found.items()} == {
        "ROB101": "pass", "ROB102": "pass", "ROB104": "pass", "ROB201": "pass", "ROB202": "pass",
        "ROB301": "pass", "ROB103": "not_applicable", "ROB105": "not_applicable",
    }  # fmt: skip


def test_clearance_to_the_table_is_that_of_trigonometry(tmp_path):
    rows = motion(1.9, 0.9)
    found, _ = judged(tmp_path, csv(tmp_path / "a.csv", rows))
    low = 0.1 + 0.4 * np.cos(rows[:, 0]) + 0.16 * np.cos(rows.sum(axis=1)) - 0.03 + 0.1
    assert low.min() < 0.01
    assert found["ROB202"].verdict == "violation"
    assert found["ROB202"].value == pytest.approx(low.min(), abs=1e-5)
    high, _ = judged(tmp_path, csv(tmp_path / "b.csv", rows), TABLE.replace("-0.1]", "-0.3]"))
    assert high["ROB202"].verdict == "pass"


def test_a_box_of_the_map_stands_in_the_way(tmp_path):
    box = (
        TABLE
        + '[body.crate]\nposition = [0.5, 0, 0.3]\nshapes = [{ kind = "box", size = [0.1, 0.1, 0.1] }]\n'
    )
    found, _ = judged(tmp_path, csv(tmp_path / "a.csv", motion(0.6, 1.0)), map_=box)
    assert found["ROB202"].verdict == "violation"
    assert "crate" in found["ROB202"].explanation


def test_limits_speed_and_jolts(tmp_path):
    rows = motion(1.99, 0.5)
    found, _ = judged(tmp_path, csv(tmp_path / "a.csv", rows), map_="")
    assert found["ROB101"].verdict == "violation"  # 1.99 of ±2 rad: 99.75 % of the range
    assert found["ROB101"].value == pytest.approx(3.99 / 4, abs=1e-3)
    rows = np.column_stack([np.where(T < 4, 0.02 * T, 1.0), 0.1 * np.sin(T)])
    found, _ = judged(tmp_path, csv(tmp_path / "b.csv", rows), "")
    assert {code for code, f in found.items() if f.verdict == "violation"} == {"ROB102", "ROB104"}


def test_a_pause_of_five_seconds(tmp_path):
    found, _ = judged(tmp_path, csv(tmp_path / "a.csv", np.outer(np.minimum(T, 2), [0.3, 0.2])))
    assert found["ROB301"].verdict == "violation"
    assert found["ROB301"].time == pytest.approx(2.0, abs=0.15)


def test_a_robot_that_meets_itself(tmp_path):
    found, _ = judged(tmp_path, csv(tmp_path / "a.csv", motion(0.0, 2.9)), map_="")
    assert found["ROB201"].verdict == "pass"  # the forearm ends above the base
    long = ARM.replace("0 0 0.16", "0 0 0.4")
    (tmp_path / "long").mkdir()
    source = csv(tmp_path / "long/a.csv", motion(0.0, 2.99))
    (tmp_path / "long.urdf").write_text(long)
    done = run("import", source, "--to", tmp_path / "far", "--robot", tmp_path / "long.urdf")
    assert done.code == 0, done.err
    assert verdicts(load(tmp_path / "far"))["ROB201"].verdict == "violation"


def test_degrees_are_asked_for_and_taken(tmp_path):
    rows = motion(60.0, 40.0)
    (tmp_path / "two.urdf").write_text(ARM)
    source = csv(tmp_path / "a.csv", rows)
    done = run("import", source, "--to", tmp_path / "no", "--robot", tmp_path / "two.urdf")
    assert done.code == 2
    assert '[robot] angle = "deg"' in done.err
    _, episode = judged(tmp_path, source, map_='[robot]\nangle = "deg"\n')
    assert np.allclose(episode.frames.joint_position, np.radians(rows), atol=1e-5)


def test_without_a_robot_it_says_what_to_add(tmp_path):
    done = run("import", csv(tmp_path / "a.csv", motion()), "--to", tmp_path / "data")
    assert done.code == 2
    assert "--robot FILE" in done.err


def test_a_table_of_something_else_is_not_said_to_hold_joints(tmp_path):
    source = csv(tmp_path / "t.csv", motion(1, 1), names=("temperature", "humidity"))
    said = run("import", source, "--to", tmp_path / "data").err
    assert "has a column of time" in said
    assert "has joint positions" not in said


def test_columns_that_fit_no_joint_are_listed(tmp_path):
    (tmp_path / "two.urdf").write_text(ARM)
    source = csv(tmp_path / "a.csv", motion(), names=("x1", "x2"))
    done = run("import", source, "--to", tmp_path / "data", "--robot", tmp_path / "two.urdf")
    assert done.code == 2
    for part in ("shoulder, elbow", "x (2)", "[columns] joint_position"):
        assert part in done.err
    judged(tmp_path, source, map_='[columns]\njoint_position = "x"\n')


def test_lerobot_needs_no_map(tmp_path):
    import json

    folder = tmp_path / "in/set"
    (folder / "meta").mkdir(parents=True)
    (folder / "data/chunk-000").mkdir(parents=True)
    state = {"dtype": "float32", "shape": [2], "names": ["shoulder.pos", "elbow.pos"]}
    info = {
        "codebase_version": "v2.1",
        "fps": 30,
        "features": {"observation.state": state, "action": state},
    }
    (folder / "meta/info.json").write_text(json.dumps(info))
    rows = motion(1.0, 1.2).astype(np.float32)
    columns = {
        "observation.state": pa.array(list(rows)), "action": pa.array(list(rows)),
        "timestamp": pa.array(T), "episode_index": pa.array(np.zeros(240, int)),
    }  # fmt: skip
    pq.write_table(pa.table(columns), folder / "data/chunk-000/episode_000000.parquet")
    found, episode = judged(tmp_path, folder)
    assert np.allclose(episode.frames.joint_position, rows, atol=1e-6)
    assert found["ROB202"].verdict == "pass"


def test_a_folder_of_rules_does_not_stand_for_them():
    assert not any(code.startswith("ROB") for code in load_rules([builtin_folder()]).rules)
    assert len(load_rules(["robot"]).rules) == 8
