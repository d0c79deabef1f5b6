"""Work in several processes: in order, and one that dies takes no other along."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from simulate.record.worker_pool import Died, run_many

pytestmark = pytest.mark.simulate


def double(number: int) -> int:
    if number == 13:
        os._exit(1)
    time.sleep(0.02 * (number % 3))
    return 2 * number


def test_results_come_in_order_and_the_dead_are_named() -> None:
    items, order = [5, 3, 13, 4, 8, 1], list[int]()
    found = list(run_many(double, items, 2, order.append))
    assert isinstance(found[2], Died)
    assert [found[i] for i in (0, 1, 3, 4, 5)] == [10, 6, 8, 16, 2]
    assert sorted(order) == [1, 2, 3, 4, 5, 6]


def write_and_die(path: Path) -> str:
    with path.open("a") as file:
        file.write("x")
    os._exit(1)


def read_back(path: Path) -> str | None:
    return path.read_text() if path.exists() else None


def test_what_was_complete_before_its_process_died_is_not_done_again(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in "abc"]
    assert list(run_many(write_and_die, paths, 2, finished=read_back)) == ["x", "x", "x"]


def nap(folder: str) -> None:
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(60)


@pytest.mark.skipif(not Path("/proc").exists(), reason="looks at /proc")
def test_workers_die_with_the_process_that_started_them(tmp_path: Path) -> None:
    code = (
        "import sys, test_worker_pool, simulate.record.worker_pool\n"
        "if __name__ == '__main__':\n"
        "    list(simulate.record.worker_pool.run_many(test_worker_pool.nap, [sys.argv[1]] * 2, 2))\n"
    )
    script = tmp_path / "main.py"
    script.write_text(code, "utf-8")
    here = Path(__file__).parent
    path = os.pathsep.join([str(here), str(here.parents[1])])
    parent = subprocess.Popen(
        [sys.executable, script, tmp_path], env={**os.environ, "PYTHONPATH": path}
    )
    try:
        workers = _soon(lambda: [p.name for p in tmp_path.iterdir() if p.name.isdigit()], 2)
    finally:
        parent.send_signal(signal.SIGKILL)
        parent.wait()
    assert _soon(lambda: [w for w in workers if not _alive(w)], 2)


def _soon(found: object, wanted: int) -> list[str]:
    end = time.monotonic() + 60
    while len(now := found()) < wanted:  # type: ignore[operator]
        assert time.monotonic() < end
        time.sleep(0.05)
    return list(now)


def _alive(process: str) -> bool:
    stat = Path("/proc", process, "stat")
    try:
        return stat.read_text().rpartition(")")[2].split()[0] not in "ZX"
    except (FileNotFoundError, ProcessLookupError):
        return False
