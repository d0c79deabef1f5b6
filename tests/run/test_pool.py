"""Whatever an episode does to a process, it is one problem, and the others have their verdicts."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from misbehaving import Crashing, CrashingOnce, Hanging, Swelling, turned
from studio import block

from safestage_eval._process import children, memory_limit
from safestage_eval.errors import InputError
from safestage_eval.formats import discover, save
from safestage_eval.run.pool import Local
from safestage_eval.run.score_many import score_many
from safestage_eval.run.settings import Settings
from safestage_eval.size_limits import size
from safestage_eval.verdicts.problem import Problem

RULES = ("fsh",)
HERE = Path(__file__).parent


@pytest.fixture(scope="module")
def refs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("traces")
    for i in range(6):
        save(block(f"e{i}", room=0.005 + 0.01 * i), folder / f"e{i}.mcap")
    return discover(folder)


def judged(refs, workers=2, **settings):
    with Local(workers, Settings(RULES, **settings)) as engine:
        return dict(engine.run(enumerate(refs)))


@pytest.mark.slow
def test_each_kind_of_trouble_is_reported_and_costs_nobody_else(refs, monkeypatch):
    monkeypatch.setattr(children, "LOADING", 12.0)
    truth = score_many(refs, RULES, jobs=1)
    bad = [turned(refs[0], Crashing), turned(refs[2], Hanging), turned(refs[4], Swelling)]
    given = [bad[0], refs[1], bad[1], refs[3], bad[2], turned(refs[5], CrashingOnce)]
    found = judged(given, timeout=8.0, memory=600 << 20)
    for i in (1, 3, 5):
        assert found[i] == truth[i]
    for i, said in ((0, "died twice: SIGSEGV"), (2, "longer than 8 s"), (4, "600 MiB")):
        assert isinstance(found[i], Problem)
        assert found[i].path == str(refs[i].path)
        assert said in found[i].message


@pytest.mark.slow
def test_processes_that_cannot_begin_are_an_error(refs, monkeypatch):
    monkeypatch.setattr(children, "STARTS", 2)
    with pytest.raises(InputError, match="2 in a row could not begin: exit code 1"):
        list(Local(1, Settings(("no such rules",))).run(enumerate(refs)))


def test_episodes_are_taken_as_they_are_needed(refs):
    """A run over more episodes than fit into memory: only a few are asked for ahead."""
    taken = []

    def endless():
        for number in range(10**9):
            taken.append(number)
            yield number, refs[number % len(refs)]

    with Local(1, Settings(RULES)) as engine:
        for count, _ in enumerate(engine.run(endless())):
            assert len(taken) - count <= 64
            if count == 12:
                break


@pytest.mark.slow
def test_no_worker_outlives_whoever_started_it(refs, tmp_path):
    code = (
        "import sys, os\n"
        "from safestage_eval.run.settings import Settings\n"
        "from safestage_eval.run.pool import Local\n"
        "from safestage_eval.formats import discover\n"
        "from misbehaving import Hanging, turned\n"
        "if __name__ == '__main__':\n"
        "    refs = discover(sys.argv[1])\n"
        "    engine = Local(1, Settings(('fsh',)))\n"
        "    for _ in engine.run(enumerate([refs[0], turned(refs[1], Hanging)])):\n"
        "        print(engine._children._children[0].process.pid, flush=True)\n"
    )
    script = tmp_path / "main.py"
    script.write_text(code, "utf-8")
    started = subprocess.Popen(
        [sys.executable, script, refs[0].path.parent],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(HERE), str(HERE.parents[1])])},
    )
    pid = int(started.stdout.readline())
    started.kill()
    started.wait()
    started.stdout.close()
    end = time.monotonic() + 10
    while alive(pid):
        assert time.monotonic() < end
        time.sleep(0.05)


def alive(pid):
    try:
        with Path(f"/proc/{pid}/stat").open("rb") as stream:
            return stream.read().rpartition(b")")[2].split()[0] != b"Z"
    except OSError:
        return False


@pytest.mark.parametrize(
    ("text", "bytes_"),
    [("600MB", 600 << 20), ("2 GiB", 2 << 30), ("1.5g", 3 << 29), ("4096", 4096)],
)
def test_amounts_of_memory(text, bytes_):
    assert size(text) == bytes_


def test_no_amount_of_memory():
    with pytest.raises(InputError, match="800 MB"):
        size("plenty")


def test_a_limit_that_cannot_be_kept_is_refused(monkeypatch, tmp_path):
    assert memory_limit.limit("1 GB") == 2**30
    monkeypatch.setattr(memory_limit, "PROCESSES", tmp_path)  # a system without /proc
    with pytest.raises(InputError, match="cannot be kept"):
        memory_limit.limit("1 GB")
