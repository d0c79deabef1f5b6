"""Worker processes: forked from one that has loaded libraries where that works, else children."""

import os
import subprocess
import sys
from multiprocessing.context import SpawnContext

import pytest

from safestage_eval._process import children


@pytest.mark.skipif(not children.FORKS, reason="processes are always spawned here")
def test_a_long_temporary_folder_has_no_room_for_the_socket(monkeypatch):
    assert not isinstance(children._context("json"), SpawnContext)
    folder = "/tmp/" + "x" * 90
    monkeypatch.setattr(children, "get_temp_dir", lambda: folder)
    assert isinstance(children._context("json"), SpawnContext)


FORKED = """
import os, sys
from safestage_eval._process.children import Children, Question
def opened():
    return lambda _: os.getpid()
def ask():
    with Children(1, opened, preload="json") as children:
        return children.ask(Question(None))
if __name__ == "__main__":
    assert ask()
    pid = os.fork()
    if pid == 0:
        os._exit(0 if ask() else 1)
    print(os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]), bool(ask()))
"""


@pytest.mark.skipif(not children.FORKS, reason="processes are always spawned here")
def test_a_process_forked_after_others_were_started_starts_its_own(tmp_path):
    script = tmp_path / "forked.py"
    script.write_text(FORKED, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert done.stdout.split() == ["0", "True"], done.stderr
