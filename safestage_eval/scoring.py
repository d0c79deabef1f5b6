"""Many stored episodes, judged: one pure function per episode, in one process or several."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef, discover
from safestage_eval.formats.discover import aborted

if TYPE_CHECKING:
    from safestage_eval.cache import Memory
    from safestage_eval.episode import Episode
    from safestage_eval.rules import BindFile, RuleSet
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
    """Everything that scoring came to, in the order in which the episodes were found.

    Attributes:
        results: of the episodes that could be judged.
        problems: the others.
        rules: code → title of the rules that were loaded.
        copies: files that hold an episode which another one holds as well, bit for bit; counted
            once.
        aborted: ids of rollouts that ended in an error (of a server, say): not judged.
    """

    results: tuple[EpisodeResult, ...] = ()
    problems: tuple[Problem, ...] = ()
    rules: Mapping[str, str] = field(default_factory=dict)
    copies: tuple[str, ...] = ()
    aborted: tuple[str, ...] = ()


def score_episode(
    ref: EpisodeRef,
    rules: RuleSet,
    overrides: Mapping[str, str] | None = None,
    bind: BindFile | None = None,
    backend: str = "gjk",
    *,
    assigned_only: bool = False,
    cache: str | Path | None = None,
) -> EpisodeResult | Problem:
    """Open and judge one episode; whatever is wrong with it becomes a problem, not an exception."""
    from safestage_eval.verdicts import judge

    try:
        if ref.problem is not None:
            raise ref.problem

        def judged(episode: Episode, memory: Memory | None = None) -> EpisodeResult:
            return judge(
                episode, rules, overrides=overrides, bind=bind, trace_hash=ref.content_hash,
                backend=backend, assigned_only=assigned_only, memory=memory,
            )  # fmt: skip

        if cache is None:
            return judged(ref.open())
        from safestage_eval.cache import CacheFolder, Memory, question

        memory = Memory(CacheFolder(cache), ref)
        asked = question(ref, rules, overrides, bind, backend, assigned_only=assigned_only)
        found = memory.result(asked, lambda: judged(memory.episode, memory))
        memory.save()
        return found
    except InputError as error:
        return Problem(str(ref.path), str(error))
    except Exception as error:  # noqa: BLE001 — one episode must not cost the others
        return Problem(str(ref.path), f"{ref.path}: cannot be judged: {_told(error)}")


def score_many(
    refs: Sequence[EpisodeRef],
    rules: Sequence[str | Path],
    *,
    overrides: Mapping[str, str] | None = None,
    bind: str | Path | None = None,
    backend: str = "gjk",
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    assigned_only: bool = False,
    cache: str | Path | None = None,
) -> list[EpisodeResult | Problem]:
    """Judge episodes; what comes back is in the order of what went in.

    Args:
        refs: the episodes.
        rules: paths, folders or built-in names of rule files.
        overrides: parameter → value as written; beats every other source.
        bind: a bind file (docs/rules.md).
        backend: whose clearances: ``gjk``, our own, or ``fcl`` or ``coal`` for comparison.
        jobs: worker processes. If None, as many as there are processors, or none at all for a few
            episodes. A script that uses several needs the usual ``__main__`` guard.
        progress: told (done, total) after each episode.
        assigned_only: judge each episode by its own assigned rules alone.
        cache: a folder in which measurements are kept between runs (docs/performance.md).

    Raises:
        RuleErrors, RuleError: rules, overrides or a bind file that do not mean anything.
        InputError: a backend that does not exist, or is not installed.
    """
    from safestage_eval.geometry.backend import check_backend
    from safestage_eval.rules import load_bind, load_rules, parse_overrides

    check_backend(backend)
    loaded = load_rules(list(rules))
    parse_overrides(loaded, overrides or {})
    bound = None if bind is None else load_bind(bind, loaded)
    if bound is not None and not any(_is_bound(ref, bound) for ref in refs):
        raise InputError(
            bound.path, f"it speaks of none of the {len(refs)} episodes.",
            fix="name their tasks under [task.NAME], or their ids under [episode.ID]",
        )  # fmt: skip
    settings: dict[str, object] = {
        "overrides": overrides,
        "bind": bound,
        "backend": backend,
        "assigned_only": assigned_only,
        "cache": cache,
    }
    workers = min(jobs or os.cpu_count() or 1, len(refs))
    if workers > 1 and (jobs is not None or len(refs) >= WORTH_A_POOL):
        found = _Pool(refs, (rules, settings), workers, progress).run()
    else:
        found = []
        for ref in refs:
            found.append(score_episode(ref, loaded, **settings))  # type: ignore[arg-type]
            if progress is not None:
                progress(len(found), len(refs))
    if cache is not None:
        from safestage_eval.cache import CacheFolder

        CacheFolder(cache).prune()
    return found


def score_paths(
    traces: Iterable[str | Path],
    rules: Sequence[str | Path] = (),
    *,
    overrides: Mapping[str, str] | None = None,
    bind: str | Path | None = None,
    where: Mapping[str, str] | None = None,
    backend: str = "gjk",
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    assigned_only: bool = False,
    cache: str | Path | None = None,
) -> Scores:
    """Find, open and judge episodes.

    Args:
        traces: files and folders.
        rules: paths, folders or built-in names of rule files; all built-in ones if empty.
        where: header field → value; only episodes that match are judged.
        overrides: parameter → value as written; beats every other source.
        bind: a bind file: roles, goal, rules and values that the traces' headers lack.
        backend: whose clearances; see ``score_many``.
        jobs: worker processes; see ``score_many``.
        progress: told (done, total) after each episode.
        assigned_only: see ``score_many``.
        cache: see ``score_many``.

    Raises:
        TraceError: nothing was found.
        InputError: nothing matches ``where``.
        RuleErrors, RuleError: rules, overrides or a bind file that do not mean anything.
    """
    from safestage_eval.rules import builtin_names, load_rules

    specs = list(rules) or builtin_names()
    loaded = load_rules(specs)
    titles = {rule.code: rule.title for rule in loaded.rules.values()}
    titles.update({cost.code: cost.title for cost in loaded.costs.values()})
    every = discover(list(traces))
    refs = matching(every, where or {})
    there = set(map(id, refs))
    left_out = [ref for ref in every if aborted(ref) and id(ref) not in there]
    found = score_many(
        refs, specs, overrides=overrides, bind=bind, backend=backend, jobs=jobs, progress=progress,
        assigned_only=assigned_only, cache=cache,
    )  # fmt: skip
    results, problems, copies = _sorted_out(found)
    ids = tuple(ref.episode_id or str(ref.path) for ref in left_out)
    return Scores(tuple(results), tuple(problems), titles, tuple(copies), ids)


def matching(refs: Sequence[EpisodeRef], where: Mapping[str, str]) -> list[EpisodeRef]:
    """Episodes whose header has the wanted values, and all that cannot be read.

    A rollout that ended in an error says nothing of its policy: it is left out, unless it is asked
    for (``termination=error``). Raises InputError for an unknown field, or when nothing matches.
    """
    if where.get("termination", "").lower() != "error":
        some = [ref for ref in refs if not aborted(ref)]
        if refs and not some:
            raise InputError(
                f"{len(refs)} episodes", "every one of them ended in an error.",
                fix="record them again, or judge them all the same with --where termination=error",
            )  # fmt: skip
        refs = some
    if not where:
        return list(refs)
    known = {"episode_id", *(name for ref in refs for name in ref.fields)} - {
        "content_hash",
        "file",
    }
    for name in where:
        if name not in known and any(ref.problem is None for ref in refs):
            raise InputError(
                f"{name}={where[name]}", f"no field {name!r}.", ", ".join(sorted(known))
            )
    found = [ref for ref in refs if ref.problem is not None or _matches(ref, where)]
    if all(ref.problem is not None for ref in found):
        wanted = " and ".join(f"{name}={value}" for name, value in where.items())
        raise InputError(wanted, f"none of {len(refs)} episodes matches.")
    return found


def _is_bound(ref: EpisodeRef, bind: BindFile) -> bool:
    return bind.speaks_of(ref.fields.get("task"), ref.episode_id)


def _matches(ref: EpisodeRef, where: Mapping[str, str]) -> bool:
    fields = {"episode_id": ref.episode_id, **ref.fields}
    return all(
        str("" if fields[name] is None else fields[name]).lower() == value.lower()
        for name, value in where.items()
    )


def _sorted_out(
    found: Iterable[EpisodeResult | Problem],
) -> tuple[list[EpisodeResult], list[Problem], list[str]]:
    """Each episode once; what could not be judged, or has the id of another; paths of copies."""
    results: dict[str, EpisodeResult] = {}
    problems, copies = [], []
    for item in found:
        if isinstance(item, Problem):
            problems.append(item)
            continue
        first = results.setdefault(item.episode_id, item)
        if first is item:
            continue
        if first.trace_hash == item.trace_hash:
            copies.append(item.path)
            continue
        error = InputError(
            item.path,
            f"the id {item.episode_id!r} is taken by another episode, in {first.path}.",
            fix="give each episode its own id",
        )
        problems.append(Problem(item.path, str(error)))
    return [*results.values()], problems, copies


def _told(error: Exception) -> str:
    """An unforeseen error in one line, with the place in the code where it came up."""
    place, trace = "", error.__traceback__
    while trace is not None:
        code = trace.tb_frame.f_code
        place, trace = f"{Path(code.co_filename).name}:{trace.tb_lineno}", trace.tb_next
    return f"{type(error).__name__}: {error} ({place})"


# ---- worker processes

_worker: dict[str, object] = {}


def _start_worker(rules: Sequence[str | Path], settings: Mapping[str, object]) -> None:
    from safestage_eval import heap
    from safestage_eval.rules import load_rules

    heap.keep()
    _worker.update(settings, rules=load_rules(list(rules)))


def _work(ref: EpisodeRef) -> EpisodeResult | Problem:
    return score_episode(ref, **_worker)  # type: ignore[arg-type]


class _Pool:
    """Spawned processes, with few episodes under way at a time.

    When a process dies, those that were under way are judged one by one, so that the episode
    that kills is found and listed; then the rest goes on with a new pool.
    """

    def __init__(
        self,
        refs: Sequence[EpisodeRef],
        setup: tuple[Sequence[str | Path], Mapping[str, object]],
        workers: int,
        progress: Callable[[int, int], None] | None,
    ) -> None:
        self._refs, self._setup, self._workers = refs, setup, workers
        self._progress = progress
        self._done: dict[int, EpisodeResult | Problem] = {}

    def run(self) -> list[EpisodeResult | Problem]:
        """All results, in order."""
        while left := [i for i in range(len(self._refs)) if i not in self._done]:
            for suspect in self._judge(left, self._workers):
                for culprit in self._judge([suspect], 1):
                    path = str(self._refs[culprit].path)
                    what = f"{path}: its worker process died; out of memory, or a library crashed"
                    self._note(culprit, Problem(path, what))
        return [self._done[i] for i in range(len(self._refs))]

    def _judge(self, todo: Sequence[int], workers: int) -> list[int]:
        """Judge until done, or until a process dies; returns those that were under way then."""
        waiting, newest = iter(todo), todo[0]
        under_way: dict[Future[EpisodeResult | Problem], int] = {}
        pool = ProcessPoolExecutor(
            min(workers, len(todo)),
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_start_worker,
            initargs=self._setup,
        )
        try:
            while True:
                for newest in islice(waiting, 2 * workers - len(under_way)):
                    under_way[pool.submit(_work, self._refs[newest])] = newest
                if not under_way:
                    return []
                for future in wait(under_way, return_when=FIRST_COMPLETED).done:
                    self._note(under_way[future], future.result())
                    del under_way[future]
        except BrokenProcessPool:
            return [i for i in {*under_way.values(), newest} if i not in self._done]
        finally:
            pool.shutdown(cancel_futures=True)

    def _note(self, index: int, result: EpisodeResult | Problem) -> None:
        self._done[index] = result
        if self._progress is not None:
            self._progress(len(self._done), len(self._refs))
