"""Many stored episodes, judged: one pure function per episode, in one process or several."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef, discover

if TYPE_CHECKING:
    from safestage_eval.rules import RuleSet
    from safestage_eval.verdicts import EpisodeResult

WORTH_A_POOL = 24
"""Episodes below which starting worker processes costs more than it saves."""


@dataclass(frozen=True)
class Problem:
    """An episode that could not be judged."""

    path: str
    message: str


@dataclass(frozen=True)
class Scores:
    """Everything that scoring came to, in the order in which the episodes were found."""

    results: tuple[EpisodeResult, ...] = ()
    problems: tuple[Problem, ...] = ()
    rules: Mapping[str, str] = field(default_factory=dict)
    """Code → title of the rules that were loaded."""


def score_episode(
    ref: EpisodeRef, rules: RuleSet, overrides: Mapping[str, str] | None = None
) -> EpisodeResult | Problem:
    """Open and judge one episode; whatever is wrong with it becomes a problem, not an exception."""
    from safestage_eval.verdicts import judge

    try:
        return judge(ref.open(), rules, overrides=overrides, trace_hash=ref.content_hash)
    except InputError as error:
        return Problem(str(ref.path), str(error))
    except (MemoryError, ValueError, KeyError, IndexError, ArithmeticError, TypeError) as error:
        return Problem(
            str(ref.path), f"{ref.path}: cannot be judged: {type(error).__name__}: {error}"
        )


def score_paths(
    traces: Iterable[str | Path],
    rules: Sequence[str | Path],
    *,
    overrides: Mapping[str, str] | None = None,
    where: Mapping[str, str] | None = None,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Scores:
    """Find, open and judge episodes.

    Args:
        traces: files and folders.
        rules: paths, folders or built-in names of rule files.
        overrides: parameter → value as written; beats every other source.
        where: header field → value; only episodes that match are judged.
        jobs: worker processes; as many as there are processors if None.
        progress: told (done, total) after each episode.

    Raises:
        TraceError: nothing was found.
        RuleErrors, RuleError: rules or overrides that do not mean anything.
    """
    from safestage_eval.rules import load_rules, parse_overrides

    loaded = load_rules(list(rules))
    parse_overrides(loaded, overrides or {})
    refs = [ref for ref in discover(list(traces)) if _matches(ref, where or {})]
    if not refs:
        raise InputError(
            ", ".join(map(str, traces)),
            f"no episode matches {' and '.join(f'{k}={v}' for k, v in (where or {}).items())}.",
        )
    workers = min(jobs or os.cpu_count() or 1, len(refs))
    if workers > 1 and (jobs is not None or len(refs) >= WORTH_A_POOL):
        found = _score_in_pool(refs, rules, overrides or {}, workers, progress)
    else:
        found = []
        for ref in refs:
            found.append(score_episode(ref, loaded, overrides))
            if progress is not None:
                progress(len(found), len(refs))
    return Scores(
        tuple(r for r in found if not isinstance(r, Problem)),
        tuple(r for r in found if isinstance(r, Problem)),
        {rule.code: rule.title for rule in loaded.rules.values()},
    )


def _matches(ref: EpisodeRef, where: Mapping[str, str]) -> bool:
    return ref.problem is not None or all(
        str(ref.fields.get(name)) == value for name, value in where.items()
    )


# ---- worker processes

_worker: dict[str, object] = {}


def _start_worker(rules: Sequence[str | Path], overrides: Mapping[str, str]) -> None:
    from safestage_eval.rules import load_rules

    _worker["rules"], _worker["overrides"] = load_rules(list(rules)), overrides


def _work(ref: EpisodeRef) -> EpisodeResult | Problem:
    return score_episode(ref, _worker["rules"], _worker["overrides"])  # type: ignore[arg-type]


def _score_in_pool(
    refs: Sequence[EpisodeRef],
    rules: Sequence[str | Path],
    overrides: Mapping[str, str],
    workers: int,
    progress: Callable[[int, int], None] | None,
) -> list[EpisodeResult | Problem]:
    """Judge in spawned processes; when one dies, what is left is judged one by one.

    So the episode that kills its worker is found, listed, and the others finish.
    """
    done: dict[int, EpisodeResult | Problem] = {}

    def note(index: int, result: EpisodeResult | Problem) -> None:
        done[index] = result
        if progress is not None:
            progress(len(done), len(refs))

    def pool(size: int) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            size,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_start_worker,
            initargs=(rules, overrides),
        )

    try:
        with pool(workers) as executor:
            futures = {executor.submit(_work, ref): i for i, ref in enumerate(refs)}
            for future in as_completed(futures):
                note(futures[future], future.result())
    except BrokenProcessPool:
        left = [i for i in range(len(refs)) if i not in done]
        while left:
            with pool(1) as executor:
                try:
                    while left:
                        note(left[0], executor.submit(_work, refs[left[0]]).result())
                        left.pop(0)
                except BrokenProcessPool:
                    ref = refs[left[0]]
                    note(
                        left.pop(0), Problem(str(ref.path), f"{ref.path}: its worker process died")
                    )
    return [done[i] for i in range(len(refs))]
