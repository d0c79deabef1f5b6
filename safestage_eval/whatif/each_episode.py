"""A function over many things, in this process or in several."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from typing import Any, TypeVar

from safestage_eval._process.children import WORTH_A_POOL
from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef
from safestage_eval.verdicts.problem import Problem

Result = TypeVar("Result")

Progress = Callable[[int, int], None]
"""Called with (done, total)."""


def each_episode(
    refs: Sequence[EpisodeRef],
    work: Callable[[EpisodeRef], Result],
    *,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> tuple[list[Result], list[Problem]]:
    """Call ``work`` on each episode; returns the results in order, and the episodes that failed.

    Arguments and errors are those of ``each``.
    """
    items = each(refs, partial(_guarded, work), jobs=jobs, progress=progress)
    problems = [item for item in items if isinstance(item, Problem)]
    return [item for item in items if not isinstance(item, Problem)], problems


def each(
    items: Sequence[Any],
    work: Callable[[Any], Any],
    *,
    jobs: int | None = None,
    worth: int = WORTH_A_POOL,
    progress: Progress | None = None,
) -> list[Any]:
    """Call ``work`` on each item, in order.

    Args:
        items: can be pickled.
        work: a function that can be pickled; every process gets it once.
        jobs: worker processes. If None, as many as there are processors, or none at all for fewer
            than ``worth`` items.
        worth: how many items are worth starting processes for.
        progress: called with (done, total) after each item.

    Raises:
        InputError: a worker process died.
    """
    workers = min(jobs or os.cpu_count() or 1, len(items))
    results: list[Any] = []
    if workers <= 1 or (jobs is None and len(items) < worth):
        for item in items:
            results.append(work(item))
            if progress is not None:
                progress(len(results), len(items))
        return results
    try:
        with ProcessPoolExecutor(
            workers,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_start,
            initargs=(work,),
        ) as pool:
            for result in pool.map(_work, items):
                results.append(result)
                if progress is not None:
                    progress(len(results), len(items))
    except BrokenProcessPool:
        raise InputError(
            "worker processes",
            "one died; out of memory, or a library crashed.",
            fix="--jobs 1, and safestage score lists the episode that kills",
        ) from None
    return results


_worker: dict[str, Callable[[Any], Any]] = {}


def _start(work: Callable[[Any], Any]) -> None:
    _worker["work"] = work


def _work(item: Any) -> Any:
    return _worker["work"](item)


def _guarded(work: Callable[[EpisodeRef], Any], ref: EpisodeRef) -> Any:
    try:
        return work(ref)
    except InputError as error:
        return Problem(ref.shown, str(error))
    except Exception as error:  # noqa: BLE001 — one episode must not cost the others
        return Problem(ref.shown, f"{ref.shown}: cannot be judged: {type(error).__name__}: {error}")
