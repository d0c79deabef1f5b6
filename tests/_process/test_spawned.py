"""Worker processes: forked from one that has loaded libraries where that works, else spawned."""

import os
import subprocess
import sys
from multiprocessing.context import SpawnContext

import pytest

from safestage_eval._process import spawned


@pytest.mark.skipif(not spawned.FORKS, reason="processes are always spawned here")
def test_a_long_temporary_folder_has_no_room_for_the_socket(monkeypatch):
    assert not isinstance(spawned._context("json"), SpawnContext)
    folder = "/tmp/" + "x" * 90
    monkeypatch.setattr(spawned, "get_temp_dir", lambda: folder)
    assert isinstance(spawned._context("json"), SpawnContext)
    spawned.prepare("json")  # starts nothing, and does not fail


FORKED = """
import os, sys
from safestage_eval._process import spawned
def answer(pipe):
    pipe.send(os.getpid())
def ask():
    child = spawned.Spawned.start(answer, preload="json")
    asked = child.pipe.recv()
    child.end(5.0)
    return asked
if __name__ == "__main__":
    assert ask()
    pid = os.fork()
    if pid == 0:
        os._exit(0 if ask() else 1)
    print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), bool(ask()))
"""


@pytest.mark.skipif(not spawned.FORKS, reason="processes are always spawned here")
def test_a_process_forked_after_others_were_started_starts_its_own(tmp_path):
    script = tmp_path / "forked.py"
    script.write_text(FORKED, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert done.stdout.split() == ["0", "True"], done.stderr
