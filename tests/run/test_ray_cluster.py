"""Ray says what one machine says, verdict for verdict, also when a worker is killed on the way."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import ray_tasks
from studio import block

from safestage_eval.formats import save
from safestage_eval.report import render
from safestage_eval.run.score_traces import score_paths

pytest.importorskip("ray")
pytestmark = pytest.mark.slow
HERE = Path(__file__).parent
MAIN = """
import sys
from safestage_eval.cli import main
if __name__ == "__main__":
    if len(sys.argv) > 2 and sys.argv[1] == "--with-a-crash":
        del sys.argv[1]
        from misbehaving import Crashing, turned
        from safestage_eval.run import score_traces
        found = score_traces.find
        score_traces.find = lambda paths: (
            turned(ref, Crashing) if ref.episode_id == "e2" else ref for ref in found(paths)
        )
    main()
"""


@pytest.fixture(scope="module")
def traces(tmp_path_factory):
    folder = tmp_path_factory.mktemp("traces")
    for i in range(16):
        save(block(f"e{i}", room=0.002 * i), folder / f"e{i:02}.mcap")
    (folder / "broken.mcap").write_bytes(b"\x89MCAP0\r\n and no more")
    return folder


def started(tmp_path, *arguments):
    script = tmp_path / "main.py"
    script.write_text(MAIN, "utf-8")
    path = os.pathsep.join([str(HERE), str(HERE.parents[1])])
    environment = {**os.environ, "PYTHONPATH": path, "RAY_DISABLE_IMPORT_WARNING": "1"}
    environment.pop("RAY_ADDRESS", None)
    return subprocess.Popen(
        [sys.executable, script, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )


def test_verdict_for_verdict_the_same_with_workers_killed_and_an_episode_that_kills(
    traces, tmp_path
):
    command = ("score", traces, "-r", "fsh", "-f", "json", "--engine", "ray")
    run = started(tmp_path, "--with-a-crash", *command, "--resume", tmp_path / "kept")
    killed, waited = [], time.monotonic() + 500
    while run.poll() is None and len(killed) < 2 and time.monotonic() < waited:
        for pid in ray_tasks(run.pid):
            if pid not in killed:
                os.kill(pid, signal.SIGKILL)
                killed.append(pid)
                break
        time.sleep(0.2)
    out, err = run.communicate(timeout=500)
    assert killed
    assert run.returncode == 2, err
    found, truth = json.loads(out), score_paths([traces], ["fsh"], jobs=1)
    rows = json.loads(render(truth, "json"))["episodes"]
    assert found["episodes"] == [row for row in rows if row["episode_id"] != "e2"], err
    said = [problem["message"] for problem in found["problems"]]
    assert len(said) == 2  # with the broken one
    assert any("died twice: SIGSEGV" in line for line in said)
