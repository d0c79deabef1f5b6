"""A process that is killed loses at most the last second: what it recorded is made a trace."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

mujoco = pytest.importorskip("mujoco")

from test_mujoco_recorder import command, scene  # noqa: E402
from zip_arrays import read  # noqa: E402

import safestage_record  # noqa: E402
from safestage_record.__main__ import main  # noqa: E402

HERE = Path(__file__).resolve().parent

PROGRAM = """
import itertools, sys, mujoco, safestage_record
sys.path.insert(0, sys.argv[1])
from test_mujoco_recorder import command, scene
safestage_record.rollout_recorder.LONGEST_WAIT = 0.02
model, data = scene()
recorder = safestage_record.mujoco(model, data, sys.argv[2], up="guess")
for i in itertools.count():
    command(data, i)
    mujoco.mj_step(model, data, nstep=20)
    recorder.step(data.ctrl)
    recorder.success(i >= 30)
"""


def rollout(path, steps):
    model, data = scene()
    with safestage_record.mujoco(model, data, path, up="guess") as recorder:
        for i in range(steps):
            command(data, i)
            mujoco.mj_step(model, data, nstep=20)
            recorder.step(data.ctrl)
            recorder.success(i >= 30)


def start(program, *arguments):
    roots = os.pathsep.join([str(HERE.parent), *sys.path])
    return subprocess.Popen(
        [sys.executable, "-c", program, str(HERE), *map(str, arguments)],
        env=dict(os.environ, PYTHONPATH=roots),
    )


def test_what_a_killed_process_had_recorded_is_the_beginning_of_the_whole_rollout(tmp_path, capsys):
    path = tmp_path / "t.zip"
    journal = tmp_path / "t.zip.unfinished"
    process = start(PROGRAM, path)
    until = time.monotonic() + 60
    while not (journal.exists() and journal.stat().st_size > 400_000):
        assert time.monotonic() < until
        time.sleep(0.005)
    with pytest.raises(safestage_record.RecordError, match="by a process that runs"):
        safestage_record.recover(tmp_path)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert not path.exists()
    assert main(["recover", str(tmp_path)]) == 0
    assert "t.zip: " in capsys.readouterr().out
    assert [some.name for some in tmp_path.iterdir()] == ["t.zip"]
    said, found = read(path)
    frames = len(found["t"])
    assert frames > 31 * 4
    whole = tmp_path / "whole.zip"
    rollout(whole, frames // 4 + 2)
    expected_header, expected = read(whole)
    for name in ("t", "action", "joint_position", "counts"):
        assert np.array_equal(found[name], expected[name][:frames]), name
    for name in ("position", "orientation", "linear_velocity", "angular_velocity"):
        assert np.array_equal(found[name], expected[name][:, :frames]), name
    assert np.array_equal(found["contacts"], expected["contacts"][: len(found["contacts"])])
    assert said["bodies"] == expected_header["bodies"]
    assert said["termination"] == "truncated"
    assert said["success"] is True
    assert said["success_time"] == expected_header["success_time"]
    assert "the end of the rollout" in [remark["what"] for remark in said["source"]["account"]]


def test_a_process_that_dies_as_it_writes_loses_nothing(tmp_path):
    program = (
        "import sys, os\n"
        "sys.path.insert(0, sys.argv[1])\n"
        "import safestage_record, test_rollout_log\n"
        "safestage_record.zip_trace.os.fsync = lambda _: os._exit(9)\n"
        "test_rollout_log.rollout(sys.argv[2], 9)\n"
    )
    path = tmp_path / "t.zip"
    assert start(program, path).wait() == 9
    assert not path.exists()
    assert safestage_record.recover(tmp_path) == [path]
    said, found = read(path)
    rollout(tmp_path / "whole.zip", 9)
    assert len(found["t"]) == len(read(tmp_path / "whole.zip")[1]["t"])
    assert said["success"] is None


@pytest.mark.parametrize("kept", [0.2, 0.6, 0.95])
def test_a_journal_that_is_cut_off_gives_its_whole_records(tmp_path, monkeypatch, kept):
    monkeypatch.setattr(safestage_record.rollout_recorder, "MOST_WAITING", 8)
    model, data = scene()
    recorder = safestage_record.mujoco(model, data, tmp_path / "t.zip")
    for i in range(30):
        command(data, i)
        mujoco.mj_step(model, data, nstep=20)
        recorder.step(data.ctrl)
    journal = tmp_path / "t.zip.unfinished"
    content = journal.read_bytes()
    recorder.stop()
    cut = tmp_path / "cut.zip.unfinished"
    cut.write_bytes(content[: int(kept * len(content))])
    made = safestage_record.recover(cut)
    assert made == [tmp_path / "cut.zip"]
    assert 1 <= len(read(made[0])[1]["t"]) < len(recorder)
    assert not cut.exists()


def test_the_command_says_what_is_wrong(tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("no journal")
    assert main(["recover", str(tmp_path / "notes.txt")]) == 1
    assert "end in .unfinished" in capsys.readouterr().err
    assert main(["recover", str(tmp_path)]) == 0
    assert "nothing unfinished" in capsys.readouterr().out
