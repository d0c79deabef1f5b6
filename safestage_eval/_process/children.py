"""Processes that answer questions; one that takes too much time or memory over one is ended."""

from __future__ import annotations

import multiprocessing.connection
import signal
import sys
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from .closing import Closing
from .spawned import LOOK, READY, Births, Spawned, follow

STARTING = 180.0
"""s that a process may take to begin."""

LOADING, AGAIN = 30.0, 10.0
"""s more for the first question of the first process, and of each later one: libraries are
loaded then."""

PATIENCE = 2.0
"""s that a process has to put away what it was writing, when it is asked to end."""


@dataclass(frozen=True)
class Question:
    """Task of a process, and its limits of time and memory.

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
    """Spawned processes; each has one question at a time, and is replaced when it ends over it.

    A process that dies may be killed for no fault of the question, which is therefore asked once more.
    """

    def __init__(
        self, size: int, opened: Callable[..., Callable[[Any], Any]], *args: Any,
        memory: int | None = None,
    ) -> None:  # fmt: skip
        """Nothing is started before there is a question.

        Args:
            size: processes at a time.
            opened: a module's function that is called in each with ``args`` and returns what answers.
            args: can be pickled.
            memory: bytes that a process may hold; None: any.
        """
        self._size, self._opened, self._args, self._memory = size, opened, args, memory
        self._children: list[_Child] = []
        self._warm, self._births = False, Births()

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
        tried: dict[int, Question] = {}
        while True:
            self._hand_out(source, again)
            busy = [child for child in self._children if child.asked is not None]
            if not busy:
                return
            ready = multiprocessing.connection.wait([child.pipe for child in busy], LOOK)
            for child in busy:
                question = child.asked
                assert question is not None
                if child.pipe not in ready:
                    more = 0.0 if child.warm else AGAIN if self._warm else LOADING
                    if why := child.exceeds(self._memory, more):
                        self._dismiss(child)
                        yield question, Ended(why, bound=True)
                    continue
                try:
                    answer = child.pipe.recv()
                except (EOFError, OSError):
                    how = self._death(child)
                    if not child.ready or id(question) not in tried:
                        if child.ready:
                            tried[id(question)] = question
                        again.append(question)
                    else:
                        yield question, Ended(f"its process died twice: {how}", bound=False)
                    continue
                if not child.ready:
                    child.ready, child.began = answer == READY, time.monotonic()
                    self._births.alive()
                    continue
                child.asked, child.warm, self._warm = None, True, True
                yield question, answer

    def _hand_out(self, source: Iterator[Question], again: deque[Question]) -> None:
        while True:
            child = next((child for child in self._children if child.asked is None), None)
            if child is None and len(self._children) >= self._size:
                return
            question = again.popleft() if again else next(source, None)
            if question is None:
                return
            if child is None:
                child = _Child.start(_serve, self._opened, *self._args)
                self._children.append(child)
            child.ask(question)

    def _death(self, child: _Child) -> str:
        """How it ended. Raises InputError when none can begin."""
        child.process.join(PATIENCE)  # it closed its pipe, and may be about to end by itself
        how = self._dismiss(child)
        if not child.ready:
            self._births.dead(how)
        return how

    def _dismiss(self, child: _Child) -> str:
        """End it, with time to put away what it was writing, unless a library does not let it."""
        child.process.terminate()
        self._children.remove(child)
        return child.end(PATIENCE)


@dataclass
class _Child(Spawned):
    """A process and what it is asked."""

    asked: Question | None = None

    def ask(self, question: Question) -> None:
        self.asked = question
        self.send(question.what)

    def exceeds(self, memory: int | None, more: float) -> str:
        """Which bound it is beyond, with s more for the time; empty if none."""
        assert self.asked is not None
        limit = self.asked.seconds
        if why := self.memory_excess(memory):
            return why
        if not self.ready:
            late = self.taken() > STARTING
            return f"had no process that began within {STARTING:g} s" if late else ""
        if limit is not None and self.taken() > limit + more:
            return f"took longer than {limit:g} s (--timeout)"
        return ""


def _serve(pipe: Connection, opened: Callable[..., Callable[[Any], Any]], *args: Any) -> None:
    """Answer what comes, one after the other, until there is nobody to ask."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    follow()
    answer = opened(*args)
    try:
        pipe.send(READY)
        while True:
            pipe.send(answer(pipe.recv()))
    except (EOFError, OSError):
        return
