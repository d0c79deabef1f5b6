"""A Ray cluster: tasks that judge some episodes each, and send their results back.

Each task keeps one worker process of the local engine beside it, so that whatever an episode does
to a process is found out in the same way and told in the same words as on one machine. When the
task's own process or its machine dies, Ray runs the task again somewhere else.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef
from safestage_eval.verdicts.problem import Problem

from .pool import Local, Numbered
from .settings import Settings
from .worker import Line

FIRST, MOST = 4, 64
"""Episodes of the first tasks, and of one at most; each processor's next task has twice as many."""

RETRIES = 5
"""Times that a task is run again when its process or machine died."""

AHEAD = 2
"""Tasks that wait for each processor of the cluster."""


Found = tuple[int, Line | Problem]
"""A number, and what was found of its episode."""


def judged(
    episodes: Iterable[Numbered], settings: Settings, address: str | None
) -> Iterator[Found]:
    """What a cluster finds of the episodes, as it comes.

    Args:
        episodes: asked for as the cluster has room; they are not all held.
        settings: of the run; traces and rule files are seen by every machine.
        address: of the cluster; None: that of ``RAY_ADDRESS``, or a new one on this machine.

    Raises:
        InputError: Ray is not installed, or there is no cluster at the address.
    """
    ray, own = _connected(address)
    try:
        yield from _judged(ray, iter(episodes), settings)
    finally:
        if own:
            ray.shutdown()


def _judged(ray: Any, todo: Iterator[Numbered], settings: Settings) -> Iterator[Found]:
    task = ray.remote(num_cpus=1, max_retries=RETRIES, retry_exceptions=False)(_judge_chunk)
    shared = ray.put(settings)
    room = AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
    under_way: dict[Any, list[Numbered]] = {}
    given = 0
    while True:
        while len(under_way) < room:
            chunk = list(islice(todo, min(FIRST << given // room, MOST)))
            if not chunk:
                break
            given += 1
            under_way[task.remote([ref for _, ref in chunk], shared)] = chunk
        if not under_way:
            return
        for future in ray.wait(list(under_way), num_returns=1)[0]:
            chunk = under_way.pop(future)
            try:
                for place, result in ray.get(future):
                    yield chunk[place][0], result
            except ray.exceptions.RayError as error:
                why = str(error).strip().splitlines()[0]
                for number, ref in chunk:
                    what = f"{ref.shown}: its task ended {RETRIES + 1} times: {why}"
                    yield number, Problem(ref.shown, what)


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


def _judge_chunk(refs: list[EpisodeRef], settings: Settings) -> list[Found]:
    """Runs in a process of the cluster; the numbers are places in the list."""
    if not _kept or _kept[0][0] != settings:
        for _, old in _kept:
            old.close()
        _kept[:] = [(settings, Local(1, settings, lines=True))]
    with _nameless():
        return list(_kept[0][1].run(enumerate(refs)))
