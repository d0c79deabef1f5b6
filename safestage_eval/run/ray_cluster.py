"""A Ray cluster: tasks that judge some episodes each and write their results as a part.

Each task keeps one worker process of the local engine beside it, so that whatever an episode does
to a process is found out in the same way and told in the same words as on one machine. When the
task's own process or its machine dies, Ray runs the task again somewhere else.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, redirect_stdout
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef
from safestage_eval.verdicts.problem import Problem

from .pool import Local, Numbered
from .result_parts import Line, write
from .settings import Settings

FIRST, MOST = 4, 64
"""Episodes of the first tasks, and of one at most; each processor's next task has twice as many."""

RETRIES = 5
"""Times that a task is run again when its process or machine died."""

AHEAD = 2
"""Tasks that wait for each processor of the cluster."""


class Told(NamedTuple):
    """Messages of a task about its episodes, by their places in the task; no results."""

    part: str | None
    written: list[int]
    problems: list[tuple[int, Problem]]


class Ledger(Protocol):
    """Receives the outcome of each episode."""

    @property
    def folder(self) -> Path:
        """Folder of the parts; every machine of the cluster sees it."""

    def key(self, number: int) -> str:
        """Under which a result is kept."""

    def note(self, number: int, result: object) -> None:
        """A problem."""

    def written(self, name: str, numbers: list[int]) -> None:
        """A part and whose results are in it."""


def judge(
    episodes: Iterable[Numbered], ledger: Ledger, settings: Settings, address: str | None
) -> None:
    """Have the episodes judged by a cluster.

    Args:
        episodes: asked for as the cluster has room; with Ray running they are not all held.
        ledger: receives parts and problems.
        settings: of the run; rule files and the folder of parts are seen by every machine.
        address: of the cluster; None: that of ``RAY_ADDRESS``, or a new one on this machine.

    Raises:
        InputError: Ray is not installed, or there is no cluster at the address.
    """
    with redirect_stdout(sys.stderr):  # Ray prints there that a task failed; stdout is for results
        ray, own = _connected(address)
        try:
            _judge(ray, episodes, ledger, settings)
        finally:
            if own:
                ray.shutdown()


def _judge(ray: Any, episodes: Iterable[Numbered], ledger: Ledger, settings: Settings) -> None:
    task = ray.remote(num_cpus=1, max_retries=RETRIES, retry_exceptions=False)(_judge_chunk)
    shared = ray.put(settings)
    room = AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
    under_way: dict[Any, list[Numbered]] = {}
    todo, given, more = iter(episodes), 0, True
    while more or under_way:
        while more and len(under_way) < room:
            chunk = list(islice(todo, min(FIRST << given // room, MOST)))
            given += 1
            more = bool(chunk)
            if chunk:
                keys = [ledger.key(number) for number, _ in chunk]
                refs = [ref for _, ref in chunk]
                under_way[task.remote(refs, keys, shared, str(ledger.folder))] = chunk
        done, _ = ray.wait(list(under_way), num_returns=1) if under_way else ([], [])
        for future in done:
            _note(ray, future, under_way.pop(future), ledger)


def _note(ray: Any, future: Any, chunk: list[Numbered], ledger: Ledger) -> None:
    try:
        report: Told = ray.get(future)
    except ray.exceptions.RayError as error:
        why = str(error).strip().splitlines()[0]
        for number, ref in chunk:
            what = f"{ref.shown}: its task ended {RETRIES + 1} times: {why}"
            ledger.note(number, Problem(ref.shown, what))
        return
    for place, problem in report.problems:
        ledger.note(chunk[place][0], problem)
    if report.part is not None:
        ledger.written(report.part, [chunk[place][0] for place in report.written])


def _connected(address: str | None) -> tuple[Any, bool]:
    """Ray, and whether the connection was made here."""
    try:
        import ray
    except ImportError:
        raise InputError(
            "--engine ray", "Ray is not installed.", fix="pip install 'safestage[cluster]'"
        ) from None
    own = not ray.is_initialized()
    if own:
        try:
            ray.init(
                address=address or os.environ.get("RAY_ADDRESS") or None,
                include_dashboard=False,
                log_to_driver=False,
                configure_logging=False,
            )
        except (ConnectionError, ValueError) as error:
            raise InputError(
                f"--address {address}", f"no Ray cluster answers: {error}.",
                fix="ray status says where one is",
            ) from None  # fmt: skip
    return ray, own


_kept: list[tuple[Settings, Local]] = []
"""The worker process of this process, kept from task to task."""


@contextmanager
def _nameless() -> Iterator[None]:
    """A process that is started meanwhile does not run the file of this one again.

    Here that is Ray's own, which loads all of Ray: 100 MB in a process that never talks to it.
    """
    main = sys.modules["__main__"]
    file, main.__file__ = getattr(main, "__file__", None), None
    try:
        yield
    finally:
        main.__file__ = file


def _judge_chunk(refs: list[EpisodeRef], keys: list[str], settings: Settings, folder: str) -> Told:
    """Runs in a process of the cluster."""
    if not _kept or _kept[0][0] != settings:
        for _, old in _kept:
            old.close()
        _kept[:] = [(settings, Local(1, settings, lines=True))]
    results: list[tuple[int, Line]] = []
    problems = []
    with _nameless():
        for place, result in _kept[0][1].run(enumerate(refs)):
            if isinstance(result, Line):
                results.append((place, result))
            elif isinstance(result, Problem):
                problems.append((place, result))
    if not results:
        return Told(None, [], problems)
    part = write(Path(folder), [(keys[place], line) for place, line in results])
    return Told(part, [place for place, _ in results], problems)
