"""A function over many stored episodes, in this process or in several."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef
from safestage_eval.scoring import WORTH_A_POOL, Problem

Work = Callable[[EpisodeRef], Any]


def each_episode(
    refs: Sequence[EpisodeRef],
    work: Work,
    *,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Any]:
    """What ``work`` makes of each episode, in order; a ``Problem`` for one that cannot be judged.

    Args:
        refs: the episodes.
        work: a function that can be pickled; every process gets it once.
        jobs: worker processes. If None, as many as there are processors, or none at all for a few
            episodes.
        progress: told (done, total) after each episode.

    Raises:
        InputError: a worker process died.
    """
    workers = min(jobs or os.cpu_count() or 1, len(refs))
    found: list[Any] = []
    if workers <= 1 or (jobs is None and len(refs) < WORTH_A_POOL):
        for ref in refs:
            found.append(_guarded(ref, work))
            if progress is not None:
                progress(len(found), len(refs))
        return found
    try:
        with ProcessPoolExecutor(
            workers,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_start,
            initargs=(work,),
        ) as pool:
            for result in pool.map(_work, refs, chunksize=4):
                found.append(result)
                if progress is not None:
                    progress(len(found), len(refs))
    except BrokenProcessPool:
        raise InputError(
            "worker processes",
            "one died; out of memory, or a library crashed.",
            fix="--jobs 1, and safestage score lists the episode that kills",
        ) from None
    return found


_worker: dict[str, Work] = {}


def _start(work: Work) -> None:
    _worker["work"] = work


def _work(ref: EpisodeRef) -> Any:
    return _guarded(ref, _worker["work"])


def _guarded(ref: EpisodeRef, work: Work) -> Any:
    try:
        return work(ref)
    except InputError as error:
        return Problem(str(ref.path), str(error))
    except Exception as error:  # noqa: BLE001 — one episode must not cost the others
        return Problem(
            str(ref.path), f"{ref.path}: cannot be judged: {type(error).__name__}: {error}"
        )
