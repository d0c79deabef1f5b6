"""Recordings of vla-eval: what their steps lack is said, and joints are judged where a field has them."""

import json
import sqlite3

import numpy as np
from studio import run
from test_joint_table import ARM

from safestage_eval import load

TABLES = """CREATE TABLE episode_results (sid, eid, eval_id, task_name, episode_id, status, PRIMARY KEY (sid, eid));
CREATE TABLE step_rows (sid, eid, step_id INTEGER, fields TEXT, PRIMARY KEY (sid, eid, step_id));"""


def recording(path, *, joints):
    """Two episodes of 60 steps, the columns that are read as vla-eval 0.7.0 has them; the first succeeds."""
    base = sqlite3.connect(path)
    base.executescript(TABLES)
    for number, status in enumerate(("success", "fail")):
        base.execute(
            "INSERT INTO episode_results VALUES ('s', ?, 'e', 'stack the cubes', ?, ?)",
            (f"{number}", number, status),
        )
        for step in reversed(range(60)):
            row = {"reward": 0.0, "success": status == "success" and step >= 50, "state": [0.0] * 8}
            row |= {"qpos": [0.01 * step, 0.02 * step]} if joints else {}
            base.execute(
                "INSERT INTO step_rows VALUES ('s', ?, ?, ?)", (f"{number}", step, json.dumps(row))
            )
    base.commit()
    base.close()
    return path


def test_steps_without_objects_name_the_recorder(tmp_path):
    done = run(
        "import",
        recording(tmp_path / "recording-1.sqlite", joints=False),
        "--to",
        tmp_path / "data",
    )
    assert done.code == 2
    for told in ("reward, success, state", "safestage_record.vla_eval", "--robot FILE"):
        assert told in done.err


def test_joints_are_placed_and_success_is_theirs(tmp_path):
    source = recording(tmp_path / "recording-1.sqlite", joints=True)
    before = source.read_bytes()
    (tmp_path / "two.urdf").write_text(ARM)
    done = run(
        "import",
        source,
        "--to",
        tmp_path / "data",
        "--robot",
        tmp_path / "two.urdf",
        "--dt",
        "1/20",
    )
    assert done.code == 0, done.err
    assert source.read_bytes() == before
    first, second = (
        load(tmp_path / "data", f"recording-1/stack the cubes/{n}-{n}") for n in (0, 1)
    )
    assert np.allclose(first.frames.joint_position, np.outer(np.arange(60), [0.01, 0.02]))
    assert first.header.instruction == "stack the cubes"
    assert (first.header.success, second.header.success) == (True, False)
    assert abs(first.header.success_time - 2.5) < 1e-9


def test_another_database_is_none(tmp_path):
    base = sqlite3.connect(tmp_path / "other.sqlite")
    base.execute("CREATE TABLE step_rows (a)")
    base.commit()
    assert run("import", tmp_path / "other.sqlite", "--to", tmp_path / "data").code == 2
