"""Work spread over processes: results in order, and a process that dies takes no other work along."""

from __future__ import annotations

import multiprocessing
import multiprocessing.connection
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from itertools import islice
from typing import Generic, TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")


@dataclass(frozen=True)
class Died:
    """Stands for the result of an item whose process died twice."""

    reason: str = "its worker process died: out of memory, or a library crashed"


def run_many(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    jobs: int = 1,
    done: Callable[[int], None] | None = None,
    finished: Callable[[Item], Result | None] | None = None,
) -> Iterator[Result | Died]:
    """Do ``work`` on every item; results come in the order of the items, each as soon as it can.

    When a process dies, what was under way is done once more, one item at a time, so that the item
    that kills is found; the others go on in new processes. Work with lasting effects must not be
    done twice: of what was complete before its process died, ``finished`` returns the result.

    Args:
        work: a function of a module, as processes are spawned.
        items: what can be pickled.
        jobs: processes; with 1 all is done in this one.
        done: called with the number of items done, in whatever order.
        finished: the result of an item whose work is complete already; None if it is not.
    """
    if min(jobs, len(items)) <= 1:
        for n, item in enumerate(items, 1):
            result = work(item)
            if done is not None:
                done(n)
            yield result
        return
    yield from _Pool(work, items, jobs, done, finished or (lambda _: None)).run()


class _Pool(Generic[Item, Result]):
    def __init__(
        self,
        work: Callable[[Item], Result],
        items: Sequence[Item],
        jobs: int,
        done: Callable[[int], None] | None,
        finished: Callable[[Item], Result | None],
    ) -> None:
        self._work, self._items, self._jobs, self._tell = work, items, jobs, done
        self._finished = finished
        self._results: dict[int, Result | Died] = {}
        self._given = 0

    def run(self) -> Iterator[Result | Died]:
        while left := [i for i in range(len(self._items)) if i not in self._results]:
            suspects = yield from self._go(left, self._jobs)
            for suspect in suspects:
                for culprit in (yield from self._go([suspect], 1)):
                    self._note(culprit, Died())
        yield from self._ready()

    def _go(self, todo: Sequence[int], jobs: int) -> Generator[Result | Died, None, list[int]]:
        """Work until done, or until a process dies; returns what was under way and is not complete."""
        waiting, newest = iter(todo), todo[0]
        under_way: dict[Future[Result], int] = {}
        pool = ProcessPoolExecutor(
            min(jobs, len(todo)),
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_start_worker,
        )
        try:
            while True:
                for newest in islice(waiting, jobs + 1 - len(under_way)):
                    under_way[pool.submit(self._work, self._items[newest])] = newest
                if not under_way:
                    return []
                for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                    self._note(under_way[future], future.result())
                    del under_way[future]
                yield from self._ready()
        except BrokenProcessPool:
            left = [i for i in {*under_way.values(), newest} if i not in self._results]
            return [i for i in left if not self._complete(i)]
        finally:
            pool.shutdown(cancel_futures=True)

    def _complete(self, index: int) -> bool:
        result = self._finished(self._items[index])
        if result is not None:
            self._note(index, result)
        return result is not None

    def _note(self, index: int, result: Result | Died) -> None:
        self._results[index] = result
        if self._tell is not None:
            self._tell(len(self._results))

    def _ready(self) -> Iterator[Result | Died]:
        while self._given in self._results:
            yield self._results[self._given]
            self._given += 1


def _start_worker() -> None:
    """A worker dies with an interrupt, and with the process that started it."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_follow, args=(parent.sentinel,), daemon=True).start()


def _follow(sentinel: int) -> None:
    multiprocessing.connection.wait([sentinel])
    os._exit(1)
