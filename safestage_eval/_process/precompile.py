"""Compile every kernel once per machine, in several processes, before the first verdict.

``kernel_signatures.json`` lists, per module, the kernels that Python calls and the types that it calls
them with (``benchmarks/kernel_signatures.py`` writes it). What is missing there is compiled when it is
first called; what is out of date there is left out.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import os
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from . import machine_code
from .kernel_folder import Signatures, is_writable, read_signatures, stamp

if sys.platform != "win32":  # where two processes may compile the same kernel
    import fcntl

PROGRAM = f"import sys; from {__name__} import serve; serve(sys.argv[1])"
"""Program of a compiling process."""

PROCESSES = 8
"""Compiling processes at most: each loads the compiler, and the longest kernel takes a sixth of the time."""

LOOK = 0.1
"""s between two looks whether another process has finished compiling."""

READY, COMPILED, FINISHED, ENDED = "ready", "compiled", "finished", "ended"
"""States of a compiling process: waiting for its first module, kernel compiled, module compiled, gone."""

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
            if not done.exists() and _compile(signatures, tell, total, done):
                done.touch()
    except (OSError, ValueError, KeyError):  # a full folder, or a process that died as it wrote
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


def _compile(signatures: Signatures, tell: Tell, total: int, done: Path) -> bool:
    """Compile module after module in several processes, and put their machine code into one file.

    Returns whether all was compiled.
    """
    longest_first = sorted(signatures, key=lambda module: -len(str(signatures[module])))  # roughly
    todo, words = deque(longest_first), SimpleQueue[str]()
    unfinished, compiled = len(todo), 0
    running = min(unfinished, _processors(), PROCESSES)
    parts = [done.with_suffix(f".{os.getpid()}.{number}") for number in range(running)]
    for part in parts:
        threading.Thread(target=_drive, args=(todo, words, part), daemon=True).start()
    tell(0, total)
    while running:
        word = words.get()
        running -= word == ENDED
        unfinished -= word == FINISHED
        compiled += word == COMPILED
        tell(compiled, total)
    try:
        if not unfinished:
            machine_code.join(parts, done.with_suffix(machine_code.SUFFIX))
    finally:
        for part in parts:
            part.unlink(missing_ok=True)
    return not unfinished


def _drive(todo: deque[str], words: SimpleQueue[str], part: Path) -> None:
    """Hand modules to one process as long as there are any, and pass on what it says."""
    try:
        with _start(part) as child:
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


def _start(part: Path) -> subprocess.Popen[str]:
    """A process of this package that compiles the modules that it is named, into a file."""
    return subprocess.Popen(  # noqa: S603 — this package itself
        [sys.executable, "-c", PROGRAM, str(part)],
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


def serve(part: str) -> None:
    """Compile the kernels of each module that is named on stdin; a line on stdout for each kernel.

    ``part``: the file for their machine code, written when there are no more.
    """
    from .object_code import LIBRARY_FUNCTIONS, entry_point

    gc.disable()  # nothing that a compiler makes is garbage before it ends; looking took an eighth
    signatures, found = read_signatures(), []
    _say(READY)
    for module in map(str.strip, sys.stdin):
        for kernel, all_types in signatures[module].items():
            for types in all_types:
                made = compile_one(module, kernel, types) and entry_point(module, kernel, types)
                if made:
                    found.append(machine_code.Compiled(module, kernel, types, *made))
                _say(COMPILED)
        _say(FINISHED)
    machine_code.save(Path(part), found, LIBRARY_FUNCTIONS)


def _say(word: str) -> None:
    sys.stdout.write(word + "\n")
    sys.stdout.flush()


def compile_one(module: str, kernel: str, types: list[Any]) -> bool:
    """Compile a kernel for one list of types, or find that this was done; whether it could be."""
    from numba.core.errors import NumbaError

    from .kernel_types import from_json

    try:
        getattr(importlib.import_module(module), kernel).load(tuple(map(from_json, types)))
    except (ImportError, AttributeError, TypeError, NumbaError):
        return False
    return True


def _processors() -> int:
    """How many this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
