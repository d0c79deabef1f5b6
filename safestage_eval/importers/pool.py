"""Episodes imported one after the other, or in worker processes of which any may die."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from pathlib import Path

from safestage_eval.errors import InputError

from .importer import Importer
from .one import Failed, Imported, Target, Task, import_one
from .registry import importer

Note = Callable[[Task, Imported | Failed], None]


def run_all(tasks: Sequence[Task], target: Target, jobs: int, note: Note) -> None:
    """Import each; ``note`` is told of each as it is done.

    When a worker dies, the episodes that were under way are tried alone, so that the one that
    kills is found; then the rest goes on.
    """
    if jobs <= 1 or len(tasks) <= 1:
        shelf = Shelf(target)
        for task in tasks:
            note(task, _attempt(shelf, task))
        return
    left = dict.fromkeys(tasks)
    while left:
        for suspect in _round([*left], target, jobs, note, left):
            if _round([suspect], target, 1, note, left):
                what = "its worker process died: out of memory, or a library crashed"
                note(suspect, Failed(suspect.source, f"{suspect.source}: {what}"))
                left.pop(suspect)


class Shelf:
    """The source that was read last stays open: its next episode is likely to come."""

    def __init__(self, target: Target) -> None:
        """Nothing is open."""
        self.target = target
        self._key: tuple[str, Path] | None = None
        self._open: Importer | None = None

    def source_of(self, task: Task) -> Importer:
        """Its importer, open. Raises InputError when the source cannot be read."""
        key = (task.format, task.path)
        if self._open is None or key != self._key:
            if self._open is not None:
                self._open.close()
                self._open = None
            self._open, self._key = importer(task.format)(task.path, self.target.settings), key
        return self._open


def _attempt(shelf: Shelf, task: Task) -> Imported | Failed:
    try:
        return import_one(lambda: shelf.source_of(task), task, shelf.target)
    except InputError as error:
        return Failed(task.source, str(error))
    except Exception as error:  # noqa: BLE001 — one episode must not cost the others
        what = f"{task.source}: cannot be imported: {type(error).__name__}: {error}"
        return Failed(task.source, what)


def _round(
    tasks: Sequence[Task], target: Target, jobs: int, note: Note, left: dict[Task, None]
) -> list[Task]:
    """Import until done, or until a process dies; returns those that were under way then."""
    waiting = iter(tasks)
    under_way: dict[Future[Imported | Failed], Task] = {}
    pool = ProcessPoolExecutor(
        min(jobs, len(tasks)),
        mp_context=multiprocessing.get_context("spawn"),
        initializer=_start_worker,
        initargs=(target,),
    )
    newest: list[Task] = []
    try:
        while True:
            for task in islice(waiting, 2 * jobs - len(under_way)):
                newest = [task]
                under_way[pool.submit(_work, task)] = task
            if not under_way:
                return []
            for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                note(under_way[future], future.result())
                left.pop(under_way.pop(future))
    except BrokenProcessPool:
        return [task for task in dict.fromkeys([*under_way.values(), *newest]) if task in left]
    finally:
        pool.shutdown(cancel_futures=True)


_worker: list[Shelf] = []


def _start_worker(target: Target) -> None:
    _worker[:] = [Shelf(target)]


def _work(task: Task) -> Imported | Failed:
    return _attempt(_worker[0], task)
