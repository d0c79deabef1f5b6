"""Compile every kernel once per machine, in several processes, before the first verdict.

``kernel_signatures.json`` lists, per module, the kernels that Python calls and the types that it calls
them with (``benchmarks/kernel_signatures.py`` writes it). What is missing there is compiled when it is
first called; what is out of date there is left out.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import json
import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from . import kernel_folder, machine_code
from .kernel_folder import Signatures, is_writable, read_signatures, stamp

if sys.platform != "win32":  # where two processes may compile the same kernel
    import fcntl

PROGRAM = f"from {__name__} import serve; serve()"
"""Program of a compiling process."""

GATHER = f"import sys; from {__name__} import gather; gather(*sys.argv[1:])"
"""Program of the process that puts the machine code of all kernels into one file."""

LOOK = 0.1
"""s between two looks whether another process has finished compiling."""

READY, COMPILED, FINISHED, ENDED = "ready", "compiled", "finished", "ended"
"""States of a compiling process: waiting for its first room, kernel compiled, room compiled, gone."""

Tell = Callable[[int, int], None]


def compile_kernels(tell: Tell | None = None) -> None:
    """Compile what this machine has not compiled yet, and load it: at once where nothing is missing.

    One process compiles, others that need the kernels meanwhile wait for it. A kernel that cannot be
    compiled here, or a folder that cannot be written to, is no error: the kernel is then compiled when
    it is called.

    Args:
        tell: called with (compiled, total) kernels, first with 0.
    """
    done = stamp()
    if done is not None and not done.exists():
        _compile_all(done, tell)
    machine_code.load()


def _compile_all(done: Path, tell: Tell | None) -> None:
    signatures, tell = read_signatures(), tell or (lambda *_: None)
    total = sum(len(types) for kernels in signatures.values() for types in kernels.values())
    try:
        done.parent.mkdir(parents=True, exist_ok=True)
        with _only_one(done.with_suffix(".lock"), tell, total):
            if not done.exists() and _compile(by_room(signatures), tell, total):
                _gather()
                done.touch()
    except OSError:
        return


def is_compiled() -> bool:
    """Whether this machine has compiled all kernels of this version."""
    done = stamp()
    return done is not None and done.exists()


def why_not_kept() -> str:
    """Why kernels are compiled anew by each process, in a sentence; empty where they are kept."""
    done = stamp()
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


def by_room(signatures: Signatures) -> dict[str, list[str]]:
    """Modules by their folder, largest first: kernels call no kernels of another folder."""
    rooms: dict[str, list[str]] = {}
    for module in signatures:
        rooms.setdefault(module.rpartition(".")[0], []).append(module)
    return dict(sorted(rooms.items(), key=lambda item: -_size(item[1])))


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


def _gather() -> None:
    """Have another process put all machine code into one file; without it, numba loads kernels."""
    path, quiet = machine_code.file(), subprocess.DEVNULL
    command = [sys.executable, "-c", GATHER, str(kernel_folder.SIGNATURES), str(path)]
    subprocess.run(  # noqa: S603 — this package itself
        command, stdout=quiet, stderr=quiet, env=_environment(), check=False
    )


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
    return subprocess.Popen(  # noqa: S603 — this package itself
        [sys.executable, "-c", PROGRAM],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=_environment(),
    )


def _environment() -> dict[str, str]:
    """Environment in which a process finds this package."""
    where = os.pathsep.join(
        [str(Path(__file__).parents[2]), *filter(None, [os.environ.get("PYTHONPATH")])]
    )
    return {**os.environ, "PYTHONPATH": where}


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


def gather(signatures: str, path: str) -> None:
    """Put the machine code of the kernels in a list of signatures into one file, if it can be linked."""
    from .kernel_types import from_json
    from .object_code import LIBRARY_FUNCTIONS, entry_point

    found = []
    for module, kernels in json.loads(Path(signatures).read_bytes()).items():
        for name, all_types in kernels.items():
            for types in all_types:
                if compile_one(module, name, types):
                    dispatcher = getattr(importlib.import_module(module), name).dispatcher
                    if made := entry_point(dispatcher, tuple(map(from_json, types))):
                        found.append(machine_code.Compiled(module, name, types, *made))
    machine_code.write(Path(path), found, LIBRARY_FUNCTIONS)


def compile_one(module: str, kernel: str, types: list[Any]) -> bool:
    """Compile a kernel for one list of types, or find that this was done; whether it could be."""
    from numba.core.errors import NumbaError

    from .kernel_types import from_json

    try:
        getattr(importlib.import_module(module), kernel).load(tuple(map(from_json, types)))
    except (ImportError, AttributeError, TypeError, NumbaError):
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
