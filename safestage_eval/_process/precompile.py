"""Compile every kernel once per machine, in several processes, before the first verdict.

``kernel_signatures.json`` lists, per module, the kernels that Python calls and the types that it calls
them with (``benchmarks/kernel_signatures.py`` writes it). What is missing there is compiled when it is
first called; what is out of date there is left out.
"""

from __future__ import annotations

import contextlib
import gc
import hashlib
import importlib
import json
import os
import platform
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numba
from numba.core.registry import cpu_target

from .compiled import cache_folder, cache_name, is_writable

if sys.platform != "win32":  # where two processes may compile the same kernel
    import fcntl

SIGNATURES = Path(__file__).with_name("kernel_signatures.json")
PROGRAM = f"from {__name__} import serve; serve()"
"""Program of a compiling process."""

LOOK = 0.1
"""s between two looks whether another process has finished compiling."""

READY, COMPILED, FINISHED, ENDED = "ready", "compiled", "finished", "ended"
"""States of a compiling process: waiting for its first room, kernel compiled, room compiled, gone."""

Tell = Callable[[int, int], None]


def compile_kernels(tell: Tell | None = None) -> None:
    """Compile what this machine has not compiled yet; return at once where nothing is missing.

    One process compiles, others that need the kernels meanwhile wait for it. A kernel that cannot be
    compiled here, or a folder that cannot be written to, is no error: the kernel is then compiled when
    it is called.

    Args:
        tell: called with (compiled, total) kernels, first with 0.
    """
    done = _stamp()
    if done is None or done.exists():
        return
    signatures, tell = read_signatures(), tell or (lambda *_: None)
    total = sum(len(types) for kernels in signatures.values() for types in kernels.values())
    try:
        done.parent.mkdir(parents=True, exist_ok=True)
        with _only_one(done.with_suffix(".lock"), tell, total):
            if not done.exists() and _compile(by_room(signatures), tell, total):
                done.touch()
    except OSError:
        return


def is_compiled() -> bool:
    """Whether this machine has compiled all kernels of this version."""
    done = _stamp()
    return done is not None and done.exists()


def why_not_kept() -> str:
    """Why kernels are compiled anew by each process, in a sentence; empty where they are kept."""
    done = _stamp()
    if done is not None and (done.exists() or is_writable(done.parent)):
        return ""
    return (
        "numerical kernels are compiled anew by each process, which takes time: no folder can be "
        "written to that would keep them; set NUMBA_CACHE_DIR to one"
    )


def load_kernels() -> None:
    """Load every listed kernel into this process, compiled before or now."""
    compile_kernels()
    for module, kernels in read_signatures().items():
        for kernel, all_types in kernels.items():
            for types in all_types:
                compile_one(module, kernel, types)


def by_room(signatures: dict[str, Any]) -> dict[str, list[str]]:
    """Modules by their folder, largest first: kernels call no kernels of another folder."""
    rooms: dict[str, list[str]] = {}
    for module in signatures:
        rooms.setdefault(module.rpartition(".")[0], []).append(module)
    return dict(sorted(rooms.items(), key=lambda item: -_size(item[1])))


def read_signatures() -> dict[str, dict[str, list[Any]]]:
    """Module → kernel → lists of argument types as JSON."""
    data: dict[str, dict[str, list[Any]]] = json.loads(SIGNATURES.read_bytes())
    return data


@cache
def _stamp() -> Path | None:
    """The file that says that all kernels of this version are compiled for this processor.

    None where nothing can be kept.
    """
    target = cpu_target.target_context.codegen().magic_tuple()  # as NUMBA_CPU_NAME says, if it does
    host = target, platform.machine(), sys.version
    digest = hashlib.sha256(repr((numba.__version__, host)).encode())
    digest.update(SIGNATURES.read_bytes())
    root = Path(__file__).parents[1]
    for room in by_room(read_signatures()):
        digest.update(cache_name(root.parent / room.replace(".", "/")).encode())
    chosen = numba.config.CACHE_DIR
    folder = Path(chosen) if chosen else cache_folder(Path(__file__).parent)
    return folder and folder / f"all-{digest.hexdigest()[:12]}.compiled"


@contextlib.contextmanager
def _only_one(path: Path, tell: Tell, total: int) -> Iterator[None]:
    """Hold a lock that ends with the process, however that ends."""
    if sys.platform == "win32":
        yield
        return
    with path.open("w") as lock:
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                tell(0, total)
                time.sleep(LOOK)
        yield


def _compile(rooms: Iterable[str], tell: Tell, total: int) -> bool:
    """Start processes that compile one room after the other; whether all rooms were finished."""
    todo, words = deque(rooms), SimpleQueue[str]()
    unfinished, compiled = len(todo), 0
    running = min(unfinished, _processors())
    for _ in range(running):
        threading.Thread(target=_drive, args=(todo, words), daemon=True).start()
    tell(0, total)
    while running:
        word = words.get()
        running -= word == ENDED
        unfinished -= word == FINISHED
        compiled += word == COMPILED
        tell(compiled, total)
    return not unfinished


def _drive(todo: deque[str], words: SimpleQueue[str]) -> None:
    """Hand rooms to one process as long as there are any, and pass on what it says."""
    try:
        with _start() as child:
            assert child.stdin is not None
            assert child.stdout is not None
            for line in child.stdout:
                words.put(line.strip())
                if line.strip() == COMPILED:
                    continue
                if not todo:
                    child.stdin.close()
                    break
                child.stdin.write(todo.popleft() + "\n")
                child.stdin.flush()
    except (OSError, IndexError):  # it could not be started, or died; or another one was faster
        return
    finally:
        words.put(ENDED)


def _start() -> subprocess.Popen[str]:
    """A process of this package that compiles the rooms that it is named."""
    where = os.pathsep.join(
        [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    )
    return subprocess.Popen(  # noqa: S603 — this package itself
        [sys.executable, "-c", PROGRAM],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": where},
    )


def serve() -> None:
    """Compile the kernels of each room that is named on stdin; a line on stdout for each kernel."""
    gc.disable()  # nothing that a compiler makes is garbage before it ends; looking took an eighth
    signatures = read_signatures()
    rooms = by_room(signatures)
    _say(READY)
    for room in map(str.strip, sys.stdin):
        for module in rooms[room]:
            for kernel, all_types in signatures[module].items():
                for types in all_types:
                    compile_one(module, kernel, types)
                    _say(COMPILED)
        _say(FINISHED)


def _say(word: str) -> None:
    sys.stdout.write(word + "\n")
    sys.stdout.flush()


def compile_one(module: str, kernel: str, types: list[Any]) -> bool:
    """Compile a kernel for one list of types, or find that this was done; whether it could be."""
    from .kernel_types import from_json

    try:
        dispatcher = getattr(importlib.import_module(module), kernel)
        dispatcher.compile(tuple(map(from_json, types)))
    except (ImportError, AttributeError, TypeError, numba.core.errors.NumbaError):
        return False
    return True


def _size(modules: list[str]) -> int:
    root = Path(__file__).parents[2]
    files = [root.joinpath(*module.split(".")).with_suffix(".py") for module in modules]
    return sum(file.stat().st_size for file in files if file.exists())


def _processors() -> int:
    """How many this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
