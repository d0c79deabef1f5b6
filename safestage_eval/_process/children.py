"""Processes that answer questions; one that dies, hangs or swells over a question costs that one at most."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from itertools import islice
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext, SpawnContext
from multiprocessing.process import BaseProcess
from multiprocessing.util import get_temp_dir
from typing import Any

from safestage_eval.errors import InputError

from .closing import Closing
from .memory_limit import resident

FORKS = sys.platform == "linux"
"""Whether processes may be forked from one that has loaded libraries; elsewhere systems forbid it."""

SOCKET_PATH = 107 - len("/listener-xxxxxxxx")
"""Bytes that the folder of a Unix socket may have in its path: the system allows no more."""

WORTH_A_POOL = 24
"""Episodes below which starting worker processes costs more than it saves."""

STARTING, STARTS = 180.0, 5
"""s that a process may take to begin; processes in a row that may end before they do."""

LOADING, AGAIN = 30.0, 10.0
"""s more for the first question of the first process, and of each later one: libraries are
loaded then."""

PATIENCE = 2.0
"""s that a process has to put away what it was writing, when it is asked to end."""

LOOK = 0.05
"""s between two looks at what the processes hold."""

READY = "ready"
"""First message of a new process."""


@dataclass(frozen=True)
class Question:
    """Task of a process.

    Attributes:
        what: any object that can be pickled.
        seconds: that the answer may take; None: any.
    """

    what: Any
    seconds: float | None = None


@dataclass(frozen=True)
class Ended:
    """Stands for an answer that there will be none.

    Attributes:
        why: what became of the process, as the end of a sentence on the question.
        bound: it was ended for what it took, and did not die of itself.
    """

    why: str
    bound: bool


class Children(Closing):
    """Processes of their own, replaced when they end over a question.

    A process answers in the order in which it was asked, so the question that it died over is known.
    It may have been killed for no fault of that one, which is therefore asked once more.
    """

    def __init__(
        self, size: int, opened: Callable[..., Callable[[Any], Any]], *args: Any,
        memory: int | None = None, ahead: int = 1, preload: str | None = None,
    ) -> None:  # fmt: skip
        """Nothing is started before there is a question.

        Args:
            size: processes at a time.
            opened: a module's function that is called in each with ``args`` and returns what answers.
            args: can be pickled.
            memory: bytes that a process may hold; None: any.
            ahead: questions that a process is given at a time, at most; fewer at first.
            preload: a module; processes are forked from one that has imported it, where that is
                safe, instead of starting from nothing.
        """
        self._size, self._opened, self._args = size, opened, args
        self._memory, self._ahead, self._preload = memory, ahead, preload
        self._children: list[_Child] = []
        self._warm, self._unborn = False, 0

    def close(self) -> None:
        """End the processes, at once or when they have put away what they were writing."""
        for child in self._children:
            child.process.terminate()
        for child in self._children:
            child.end(PATIENCE)
        self._children.clear()

    def ask(self, question: Question) -> Any:
        """One answer, or ``Ended``. Raises InputError when no process can be started at all."""
        for _, answer in self.run([question]):
            return answer
        raise AssertionError("every question has an answer")

    def run(self, questions: Iterable[Question]) -> Iterator[tuple[Question, Any]]:
        """Each question with its answer, or ``Ended``, in whatever order.

        Questions are taken as processes are free for them. Raises InputError when no process can
        be started at all.
        """
        source, again = iter(questions), deque[Question]()
        died: set[int] = set()
        try:
            while True:
                self._hand_out(source, again)
                busy = [child for child in self._children if child.asked]
                if not busy:
                    return
                ready = multiprocessing.connection.wait([child.pipe for child in busy], LOOK)
                for child in busy:
                    if child.pipe in ready:
                        yield from self._heard(child, again, died)
                    elif why := self._exceeds(child):
                        question = child.asked.popleft()
                        self._dismiss(child, again)
                        yield question, Ended(why, bound=True)
        finally:  # nobody waits for the rest any more
            for child in [child for child in self._children if child.asked]:
                self._dismiss(child, again)

    def _hand_out(self, source: Iterator[Question], again: deque[Question]) -> None:
        while True:
            child = next((child for child in self._children if not child.asked), None)
            if child is None and len(self._children) >= self._size:
                return
            most = child.appetite if child is not None else 1
            some = [again.popleft()] if again else list(islice(source, most))
            if not some:
                return
            if child is None:
                child = self._start()
            child.give(some)
            child.appetite = min(2 * child.appetite, self._ahead)

    def _start(self) -> _Child:
        context = _context(self._preload)
        ours, theirs = context.Pipe()
        process = context.Process(
            target=_serve, args=(theirs, self._opened, *self._args), daemon=True
        )
        process.start()
        theirs.close()
        self._children.append(_Child(process, ours))
        return self._children[-1]

    def _heard(
        self, child: _Child, again: deque[Question], died: set[int]
    ) -> Iterator[tuple[Question, Any]]:
        """A message of a process, its death included."""
        try:
            answer = child.pipe.recv()
        except (EOFError, OSError):
            child.process.join(PATIENCE)  # it closed its pipe, and may be about to end by itself
            question = child.asked.popleft()
            how = self._dismiss(child, again)
            if not child.ready:
                self._unborn += 1
                if self._unborn >= STARTS:
                    why = f"{STARTS} in a row could not begin: {how}."
                    raise InputError("worker processes", why) from None
            elif id(question) in died:
                yield question, Ended(f"its process died twice: {how}", bound=False)
                return
            else:
                died.add(id(question))
            again.appendleft(question)
            return
        child.began = time.monotonic()
        if not child.ready:
            child.ready, self._unborn = answer == READY, 0
            return
        child.warm = self._warm = True
        yield child.asked.popleft(), answer

    def _dismiss(self, child: _Child, again: deque[Question]) -> str:
        """End it, with time to put away what it was writing, unless a library does not let it.

        Others get what it was asked and has not answered.
        """
        child.process.terminate()
        self._children.remove(child)
        again.extend(child.asked)
        return child.end(PATIENCE)

    def _exceeds(self, child: _Child) -> str:
        """Which bound it is beyond; empty if none."""
        taken, limit = time.monotonic() - child.began, child.asked[0].seconds
        if self._memory is not None and resident(child.process.pid or 0) > self._memory:
            return f"took more than {self._memory / 2**20:.0f} MiB of memory (--memory)"
        if not child.ready:
            late = taken > STARTING
            return f"had no process that began within {STARTING:g} s" if late else ""
        more = 0.0 if child.warm else AGAIN if self._warm else LOADING
        if limit is not None and taken > limit + more:
            return f"took longer than {limit:g} s (--timeout)"
        return ""


@dataclass
class _Child:
    """A process, the pipe to it, what it was asked and has not answered, and how far it has come."""

    process: BaseProcess
    pipe: Connection
    asked: deque[Question] = field(default_factory=deque)
    appetite: int = 1
    began: float = field(default_factory=time.monotonic)
    """When it began with the first of what it was asked and has not answered."""
    ready: bool = False
    warm: bool = False
    """It has answered before."""

    def give(self, questions: list[Question]) -> None:
        """Only to one that has answered everything: it reads nothing else meanwhile."""
        self.asked.extend(questions)
        self.began = time.monotonic()
        try:
            self.pipe.send([question.what for question in questions])
        except OSError:
            return  # it died; reading from it will tell

    def end(self, patience: float) -> str:
        """End it, after some s in which it may end by itself; return how it ended, in words."""
        self.process.join(patience)
        self.process.kill()
        self.process.join()
        self.pipe.close()
        return ended(self.process.exitcode)


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


def _serve(pipe: Connection, opened: Callable[..., Callable[[Any], Any]], *args: Any) -> None:
    """Answer what comes, one after the other, until there is nobody to ask."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started this process ends it
    parent = multiprocessing.parent_process()
    if parent is not None:  # whatever it is busy with, it does not outlive that one
        threading.Thread(target=_wait_for, args=(parent.sentinel,), daemon=True).start()
    answer = opened(*args)
    try:
        pipe.send(READY)
        while True:
            for what in pipe.recv():
                pipe.send(answer(what))
    except (EOFError, OSError):
        return


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
