"""Processes of this machine: who runs, who started whom."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path


def pid_alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and waits to be collected does not."""
    try:
        state = Path(f"/proc/{pid}/stat").read_bytes().rpartition(b")")[2].split()[0]
    except OSError:
        return False
    return state != b"Z"


def children(pid: int) -> list[int]:
    """Processes that a process started, and that run."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(path.read_bytes().rpartition(b")")[2].split()[1])
        except OSError:
            continue
        if parent == pid and pid_alive(int(path.parent.name)):
            found.append(int(path.parent.name))
    return found


def workers(pid: int) -> list[int]:
    """Workers of a process: those that it started, and those of the server that forks for it."""
    found = []
    for child in children(pid):
        try:
            words = Path(f"/proc/{child}/cmdline").read_bytes()
        except OSError:
            continue
        if b"spawn_main" in words:
            found.append(child)
        elif b"multiprocessing.forkserver" in words:
            found += children(child)
    return found


def ray_tasks(root: int) -> list[int]:
    """Processes that judge episodes for a cluster that a process started, or one below it."""
    parents, tasks = {}, []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            pid, stat = int(path.name), (path / "stat").read_bytes()
            parents[pid] = int(stat.rpartition(b")")[2].split()[1])
            if (path / "cmdline").read_bytes().startswith(b"ray::_judge_chunk"):
                tasks.append(pid)
        except OSError:
            continue
    return [pid for pid in tasks if root in _above(pid, parents)]


def _above(pid: int, parents: dict[int, int]) -> Iterator[int]:
    while pid in parents:
        pid = parents[pid]
        yield pid
