"""A process that was spawned to answer what it is sent, and the pipe to it."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import multiprocessing.forkserver
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext, SpawnContext
from multiprocessing.process import BaseProcess
from multiprocessing.util import get_temp_dir
from typing import Any, Self

from safestage_eval.errors import InputError

from .memory_limit import resident

FORKS = sys.platform == "linux"
"""Whether processes may be forked from one that has loaded libraries; elsewhere systems forbid it."""

READY = "ready"
"""First message of a new process."""

SOCKET_PATH = 107 - len("/listener-xxxxxxxx")
"""Bytes that the folder of a Unix socket may have in its path: the system allows no more."""

STARTS = 5
"""Processes in a row that may end before they begin."""

WORTH_A_POOL = 24
"""Episodes below which starting worker processes costs more than it saves."""

LOOK = 0.05
"""s between two looks at what the processes hold."""


@dataclass
class Spawned:
    """A process, the pipe to it, and how far it has come."""

    process: BaseProcess
    pipe: Connection
    began: float = field(default_factory=time.monotonic)
    """When it began with the first of what it was sent and has not answered."""
    ready: bool = False
    warm: bool = False
    """It has answered before."""

    @classmethod
    def start(
        cls, work: Callable[..., None], *args: Any, preload: str | None = None, **named: Any
    ) -> Self:
        """Call a module's function in a new process, its end of the pipe first.

        ``preload``: a module; the process is then forked from one that has imported it, where that
        is safe, instead of starting from nothing.
        """
        context = _context(preload)
        ours, theirs = context.Pipe()
        process = context.Process(target=work, args=(theirs, *args), kwargs=named, daemon=True)
        process.start()
        theirs.close()
        return cls(process, ours)

    def send(self, what: Any) -> None:
        """Only to one that has answered everything: it reads nothing else meanwhile."""
        self.began = time.monotonic()
        try:
            self.pipe.send(what)
        except OSError:
            return  # it died; reading from it will tell

    def taken(self) -> float:
        """S since it began with what it was sent."""
        return time.monotonic() - self.began

    def memory_excess(self, memory: int | None) -> str:
        """Why it is over its memory limit (bytes), as text; empty if it is not."""
        if memory is None or not self.process.pid or resident(self.process.pid) <= memory:
            return ""
        return f"took more than {memory / 2**20:.0f} MiB of memory (--memory)"

    def end(self, patience: float = 0.0) -> str:
        """End it, after some s in which it may end by itself; return how it ended, in words."""
        self.process.join(patience)
        self.process.kill()
        self.process.join()
        self.pipe.close()
        return ended(self.process.exitcode)


def prepare(preload: str) -> None:
    """Start the process that others will be forked from; returns before it has imported anything."""
    if isinstance(_context(preload), ForkServerContext):
        multiprocessing.forkserver.ensure_running()


_server_parents: set[int] = set()
"""Ids of the processes that have asked for a fork server: this one, or one it was forked from."""


def _context(preload: str | None) -> SpawnContext | ForkServerContext:
    if preload is None or not FORKS or len(os.fsencode(get_temp_dir())) > SOCKET_PATH:
        return multiprocessing.get_context("spawn")
    _server_parents.add(os.getpid())
    if len(_server_parents) > 1:  # only the server's own parent can wait for it
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([preload])
    return context


class Births:
    """Counts processes that ended before they began, lest they be started for ever."""

    def __init__(self) -> None:
        self._dead = 0

    def alive(self) -> None:
        """One has begun."""
        self._dead = 0

    def dead(self, how: str) -> None:
        """One has not. Raises InputError after too many in a row."""
        self._dead += 1
        if self._dead >= STARTS:
            raise InputError("worker processes", f"{STARTS} in a row could not begin: {how}.")


def follow() -> None:
    """This process does not outlive the one that started it, whatever it is busy with."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started this process ends it
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_wait_for, args=(parent.sentinel,), daemon=True).start()


def _wait_for(sentinel: int) -> None:
    multiprocessing.connection.wait([sentinel])
    os._exit(1)


def ended(code: int | None) -> str:
    """How a process ended, in words, from its exit code."""
    if code is None or code >= 0:
        return f"exit code {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"
    why = {"SIGKILL": " (out of memory, or killed)", "SIGSEGV": " (a library crashed)"}
    return name + why.get(name, "")
