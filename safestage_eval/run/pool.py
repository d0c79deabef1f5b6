"""Worker processes on this machine: one that dies, hangs or swells costs one episode at most."""

from __future__ import annotations

import multiprocessing.connection
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from types import TracebackType
from typing import Self

from safestage_eval._process.children import LOADING
from safestage_eval._process.spawned import LOOK, READY, WORTH_A_POOL, Births, Spawned, prepare
from safestage_eval.formats import EpisodeRef
from safestage_eval.size_limits import current
from safestage_eval.verdicts.problem import Problem

from .engine_interface import Engine, Found, Numbered
from .settings import Settings
from .sharing import Place, Shares, place
from .worker import work

CHUNK = 0.25
"""s that the episodes which a process is sent at a time should take."""

FIRST, MOST = 2, 64
"""Episodes that a process is sent at first, and at most."""

PRELOAD = "safestage_eval.run.preload"
"""Module that several workers share."""

SELDOM = 1.0
"""s between two looks at processes that have only the usual limits."""

STUCK = 4
"""Times the processor time of an episode that may go by on the clock: machines are shared. A process ends
itself over an episode, unless it is in a library that does not come back."""


class Local(Engine):
    """Spawned processes, each with a pipe of its own.

    A process answers in the order in which it was asked, so the episode that it died over is
    known without a search. That one is tried once more, alone in a new process, because a process may be killed for
    no fault of its own; if that dies as well, the episode is a problem. The others go on.
    """

    def __init__(
        self,
        workers: int,
        settings: Settings,
        *,
        lines: bool = False,
        work: Callable[..., None] = work,
    ) -> None:
        """``lines``: give results as they are stored (``Line``); ``work``: what a process does."""
        self._settings, self._lines, self._work = settings, lines, work
        self._size = workers
        self._preload = PRELOAD if workers > 1 else None
        self._workers: list[_Worker] = []
        self._suspects: set[int] = set()
        self._back: deque[list[Numbered]] = deque()
        self._births = Births()

    def __enter__(self) -> Self:
        """Processes stay between runs until the block ends."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None
    ) -> None:
        """Ends the processes."""
        for worker in self._workers:
            worker.end()
        self._workers.clear()

    def run(self, episodes: Iterable[Numbered]) -> Iterator[tuple[int, Found]]:
        """See ``Engine.run``; within a ``with`` block."""
        shares = Shares(iter(episodes), self._size)
        while True:
            self._hand_out(shares)
            busy = [worker for worker in self._workers if worker.asked]
            if not busy:
                return
            pause = LOOK if self._settings.timeout or self._settings.memory else SELDOM
            ready = multiprocessing.connection.wait([worker.pipe for worker in busy], pause)
            for worker in busy:
                if worker.pipe in ready:
                    yield from self._answer(worker)
                elif why := self._exceeds(worker):
                    number, ref = worker.asked.popleft()
                    self._dismiss(worker)
                    yield number, Problem(ref.shown, f"{ref.shown}: {why}")

    def _hand_out(self, shares: Shares) -> None:
        """Give every process something to do, as far as there is something."""
        while True:
            worker = next((worker for worker in self._workers if not worker.asked), None)
            if worker is None and len(self._workers) >= self._size:
                return
            chunk = self._back.popleft() if self._back else self._share(shares, worker)
            if not chunk:
                return
            if worker is None:
                worker = _Worker.start(
                    self._work, self._settings, lines=self._lines, preload=self._preload
                )
                self._workers.append(worker)
            worker.give(chunk)

    def _share(self, shares: Shares, worker: _Worker | None) -> list[Numbered]:
        """Next episodes for a process; ``worker``: None for a new one."""
        others = {other.place for other in self._workers if other is not worker}
        if worker is None:
            return shares.take(FIRST, None, others)
        return shares.take(worker.appetite, worker.place, others)

    def _answer(self, worker: _Worker) -> Iterator[tuple[int, Found]]:
        """Messages of a process, its death included."""
        try:
            answer = worker.pipe.recv()
        except (EOFError, OSError):
            yield from self._death(worker)
            return
        worker.began = time.monotonic()
        if answer == READY:
            worker.ready = True
            self._births.alive()
            return
        worker.warm = True
        number, _ = worker.asked.popleft()
        self._suspects.discard(number)
        worker.answered()
        yield number, answer

    def _death(self, worker: _Worker) -> Iterator[tuple[int, Found]]:
        how = worker.end(patience=5.0)
        if not worker.ready:
            self._dismiss(worker)
            self._births.dead(how)
            return
        number, ref = worker.asked.popleft()
        self._dismiss(worker)
        if number in self._suspects:
            self._suspects.discard(number)
            yield number, Problem(ref.shown, f"{ref.shown}: its process died twice: {how}")
        else:
            self._suspects.add(number)
            self._back.append([(number, ref)])

    def _dismiss(self, worker: _Worker) -> None:
        """End a process; another one gets what it was asked and has not answered."""
        worker.end()
        self._workers.remove(worker)
        if worker.asked:
            self._back.append(list(worker.asked))

    def _exceeds(self, worker: _Worker) -> str:
        """Which bound a process is beyond; empty if none."""
        most, limit = self._settings.memory, self._settings.timeout
        if limit is None and worker.warm and worker.taken() > STUCK * current().seconds:
            return f"judging it came to no end in {worker.taken():.0f} s (--limits seconds=NUMBER)"
        if why := worker.memory_excess(most):
            return f"judging it {why}"
        if limit is not None and worker.ready:
            more = 0.0 if worker.warm else LOADING
            if worker.taken() > limit + more:
                return f"judging it took longer than {limit:g} s (--timeout)"
        return ""


@dataclass
class _Worker(Spawned):
    """A process and what it was asked and has not answered, in order."""

    asked: deque[Numbered] = field(default_factory=deque)
    appetite: int = FIRST
    place: Place | None = None
    """Files that the last episode it was asked for is in."""
    _given: tuple[int, float] = (0, 0.0)

    def give(self, chunk: list[Numbered]) -> None:
        """Only to one that has answered everything."""
        self.place = place(chunk[-1])
        self.asked.extend(chunk)
        self.send([ref for _, ref in chunk])
        self._given = len(chunk), self.began

    def answered(self) -> None:
        """After each answer: how many episodes fill the time, if this was the last one."""
        if not self.asked:
            count, began = self._given
            fits = CHUNK * count / max(time.monotonic() - began, 1e-6)
            self.appetite = int(min(max(fits, 1), 2 * self.appetite, MOST))


def with_workers(refs: Iterable[EpisodeRef], jobs: int | None) -> Iterator[EpisodeRef]:
    """Yield the items; start workers as soon as there are enough episodes for them."""
    enough = WORTH_A_POOL if jobs is None else 2 if jobs > 1 else None
    for count, ref in enumerate(refs, 1):
        if count == enough:
            prepare(PRELOAD)
        yield ref
