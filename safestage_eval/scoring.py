"""Many stored episodes, judged: one pure function per episode, in one process or several."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef, discover
from safestage_eval.formats.chosen import Chosen

if TYPE_CHECKING:
    from safestage_eval.engines import Settings
    from safestage_eval.episode import Episode
    from safestage_eval.evidence.cache_folder import CacheFolder
    from safestage_eval.evidence.store import Store
    from safestage_eval.rules import BindFile, RuleSet
    from safestage_eval.verdicts import EpisodeResult, Verdict

WORTH_A_POOL = 24
"""Episodes below which starting worker processes costs more than it saves."""


@dataclass(frozen=True)
class Problem:
    """An episode that could not be judged."""

    path: str
    message: str


@dataclass(frozen=True)
class Gates:
    """Which verdicts count where a build may fail: ``--fail-on``, golden files, JUnit, annotations.

    Those of assigned rules always do; besides, those of rules that the user named (docs/ci.md).

    Attributes:
        named: codes of rules whose file was named: they count in every episode.
        chosen: codes of rules of a folder or built-in set that was named: they count in episodes
            to which nothing is assigned.
    """

    named: frozenset[str] = frozenset()
    chosen: frozenset[str] = frozenset()

    def counted(self, result: EpisodeResult) -> tuple[Verdict, ...]:
        """The verdicts that count."""
        assigned = bool(result.assigned or result.not_loaded)
        extra = self.named if assigned else self.named | self.chosen
        return tuple(v for v in result.verdicts if v.assigned or v.rule in extra)

    def violation(self, result: EpisodeResult) -> bool | None:
        """Whether any of them is a violation; None where that is open, or nothing was judged."""
        found = self.counted(result)
        if any(v.verdict == "violation" for v in found):
            return True
        open_ = any(v.violation is None or v.vacuity == "unbound" for v in found)
        return None if not found or open_ or result.not_loaded else False

    @classmethod
    def of(cls, rules: Sequence[str | Path]) -> Gates:
        """Of rule files as they were named; the default, all built-in sets, names none."""
        from safestage_eval.rules import builtin_names
        from safestage_eval.rules.files import codes_of

        if list(rules) == builtin_names():
            return cls()
        files = [spec for spec in rules if Path(spec).is_file()]
        named = codes_of(files)
        return cls(named, codes_of([spec for spec in rules if spec not in files]) - named)


@dataclass(frozen=True)
class Scores:
    """Everything that scoring came to, in the order in which the episodes were found.

    Attributes:
        results: of the episodes that could be judged; those of a long run stay on disk and are
            read as they are looked at.
        problems: the others.
        rules: code → title of the rules that were loaded.
        copies: files that hold an episode which another one holds as well, bit for bit; counted
            once.
        aborted: ids of rollouts that ended in an error (of a server, say): not judged.
        sample: which share of the episodes was judged, in words; empty if all were.
        gates: which verdicts count where a build may fail.
    """

    results: Sequence[EpisodeResult] = ()
    problems: tuple[Problem, ...] = ()
    rules: Mapping[str, str] = field(default_factory=dict)
    copies: tuple[str, ...] = ()
    aborted: tuple[str, ...] = ()
    sample: str = ""
    gates: Gates = Gates()


def score_episode(
    ref: EpisodeRef,
    rules: RuleSet,
    overrides: Mapping[str, str] | None = None,
    bind: BindFile | None = None,
    backend: str = "gjk",
    *,
    assigned_only: bool = False,
    cache: str | Path | CacheFolder | None = None,
) -> EpisodeResult | Problem:
    """Open and judge one episode; whatever is wrong with it becomes a problem, not an exception."""
    from safestage_eval import blas
    from safestage_eval.verdicts import judge

    blas.postpone()
    try:
        if ref.problem is not None:
            raise ref.problem

        def judged(episode: Episode, store: Store | None = None) -> EpisodeResult:
            return judge(
                episode, rules, overrides=overrides, bind=bind, backend=backend,
                assigned_only=assigned_only, store=store,
            )  # fmt: skip

        if cache is None:
            return judged(ref.open())
        from safestage_eval.engines.result_question import result_question
        from safestage_eval.evidence.cache_folder import CacheFolder
        from safestage_eval.evidence.disk_store import DiskStore
        from safestage_eval.verdicts.verdict_json import result_from_json, to_json

        folder = cache if isinstance(cache, CacheFolder) else CacheFolder(cache)
        asked = result_question(ref, rules, overrides, bind, backend, assigned_only=assigned_only)
        store = DiskStore(folder, ref)
        found = store.answer(asked, lambda: to_json(judged(store.episode, store)))
        store.save()
        return result_from_json(found, ref.shown)
    except InputError as error:
        return Problem(ref.shown, str(error))
    except Exception as error:  # noqa: BLE001 — one episode must not cost the others
        return Problem(ref.shown, f"{ref.shown}: cannot be judged: {_told(error)}")


def score_many(
    refs: Sequence[EpisodeRef],
    rules: Sequence[str | Path] = (),
    *,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    settings: Settings | None = None,
    **asked: Any,
) -> list[EpisodeResult | Problem]:
    """Judge episodes; what comes back is in the order of what went in.

    Args:
        refs: the episodes.
        rules: paths, folders or built-in names of rule files.
        jobs: worker processes. If None, as many as there are processors, or none at all for a few
            episodes. A script that uses several needs the usual ``__main__`` guard.
        progress: told (done, total) after each episode.
        settings: from ``understood``, instead of rules and what follows.
        asked: the other arguments of ``understood``.

    Raises:
        RuleErrors, RuleError, InputError: as ``understood``, and a bind file that speaks of none of
            the episodes.
    """
    settings = settings or understood(rules, **asked)
    speaks(settings.bind, refs)
    workers = min(jobs or os.cpu_count() or 1, len(refs))
    several = workers > 1 and (jobs is not None or len(refs) >= WORTH_A_POOL)
    if refs and (several or settings.timeout is not None or settings.memory is not None):
        found = _in_processes(refs, settings, workers if several else 1, progress)
    else:
        loaded, found = settings.load(), []
        for ref in refs:
            found.append(score_episode(ref, loaded, **settings.arguments()))
            if progress is not None:
                progress(len(found), len(refs))
    if settings.cache is not None:
        from safestage_eval.evidence.cache_folder import CacheFolder

        CacheFolder(settings.cache).prune()
    return found


def understood(
    rules: Sequence[str | Path],
    *,
    overrides: Mapping[str, str] | None = None,
    bind: str | Path | None = None,
    backend: str = "gjk",
    assigned_only: bool = False,
    cache: str | Path | None = None,
    timeout: float | None = None,
    memory: int | None = None,
) -> Settings:
    """Settings of which everything means something.

    Args:
        rules: paths, folders or built-in names of rule files.
        overrides: parameter → value as written; beats every other source.
        bind: a bind file: roles, goal, rules and values that the traces' headers lack.
        backend: whose clearances: ``gjk``, our own, or ``fcl`` or ``coal`` for comparison.
        assigned_only: judge each episode by its own assigned rules alone.
        cache: a folder in which measurements are kept between runs (docs/performance.md).
        timeout: s that an episode may take; one that takes longer is a problem.
        memory: bytes that the process which judges an episode may hold; likewise. Either needs a
            worker process, so there is one at least.

    Raises:
        RuleErrors, RuleError: rules, overrides or a bind file that do not mean anything.
        InputError: a backend that does not exist, or is not installed.
    """
    from safestage_eval.engines import Settings
    from safestage_eval.rules import load_bind, load_rules, parse_overrides
    from safestage_eval.rules.digest import BACKEND

    if backend != BACKEND:  # which is there always, and takes long to load
        from safestage_eval.geometry.backend import check_backend

        check_backend(backend)
    loaded = load_rules(list(rules))
    parse_overrides(loaded, overrides or {})
    bound = None if bind is None else load_bind(bind, loaded)
    return Settings(
        tuple(rules), overrides, bound, backend, assigned_only, cache, False, timeout, memory
    )


def speaks(bind: BindFile | None, refs: Iterable[EpisodeRef]) -> None:
    """Raises InputError where a bind file speaks of none of the episodes."""
    if bind is None:
        return
    count = 0
    for ref in refs:
        if bind.speaks_of(ref.fields.get("task"), ref.episode_id):
            return
        count += 1
    raise InputError(
        bind.path, f"it speaks of none of the {count} episodes.",
        fix="name their tasks under [task.NAME], or their ids under [episode.ID]",
    )  # fmt: skip


def misspelt_roles(bind: BindFile | None, rules: RuleSet) -> list[str]:
    """What is told of roles in a bind file that no rule has, where one has a role of a similar name.

    A role without such a namesake is no mistake: rules that are not loaded may ask for it.
    """
    scoped = [*rules.scoped.values(), *rules.goals.values()]
    there = {role for item in scoped for role, _ in item.roles}
    found: dict[str, None] = {}
    for name, task in ({} if bind is None else {**bind.tasks, **bind.episodes}).items():
        for role, _ in task.roles:
            near = get_close_matches(role, there, 1, 0.8)
            if role not in there and near:
                found[f'{name}: no loaded rule has a role {role}: did you mean "{near[0]}"?'] = None
    return [f"{bind.path}: {told}" for told in found] if bind is not None else []


def _in_processes(
    refs: Sequence[EpisodeRef],
    settings: Settings,
    workers: int,
    progress: Callable[[int, int], None] | None,
) -> list[EpisodeResult | Problem]:
    from safestage_eval.engines.local import Local

    found: dict[int, Any] = {}
    with Local(workers, settings) as engine:
        for number, result in engine.run(enumerate(refs)):
            found[number] = result
            if progress is not None:
                progress(len(found), len(refs))
    return [found[number] for number in range(len(refs))]


def score_paths(
    traces: Iterable[str | Path],
    rules: Sequence[str | Path] = (),
    *,
    where: Mapping[str, str] | None = None,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    **asked: Any,
) -> Scores:
    """Find, open and judge episodes; all results are held in memory (``engines.run`` holds none).

    Args:
        traces: files and folders.
        rules: paths, folders or built-in names of rule files; all built-in ones if empty.
        where: header field → value; only episodes that match are judged.
        jobs: worker processes; see ``score_many``.
        progress: told (done, total) after each episode.
        asked: the other arguments of ``understood``.

    Raises:
        TraceError: nothing was found.
        InputError: nothing matches ``where``.
        RuleErrors, RuleError: rules, overrides or a bind file that do not mean anything.
    """
    from safestage_eval.rules import builtin_names

    specs = list(rules) or builtin_names()
    settings = understood(specs, **asked)
    chosen = Chosen(discover(list(traces)), where)
    found = score_many([*chosen], settings=settings, jobs=jobs, progress=progress)
    results, problems, copies = sorted_out(found)
    aborted = tuple(chosen.aborted)
    return Scores(
        tuple(results),
        tuple(problems),
        titles(specs),
        tuple(copies),
        aborted,
        gates=Gates.of(specs),
    )


def titles(rules: Sequence[str | Path]) -> dict[str, str]:
    """Code → title of all rules and costs."""
    from safestage_eval.rules import load_rules

    loaded = load_rules(list(rules))
    found = {rule.code: rule.title for rule in loaded.rules.values()}
    return found | {cost.code: cost.title for cost in loaded.costs.values()}


def sorted_out(
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
        problems.append(taken(item.episode_id, item.path, first.path))
    return [*results.values()], problems, copies


def taken(episode_id: str, path: str, first: str) -> Problem:
    """What is said of an episode whose id another one has."""
    error = InputError(
        path,
        f"the id {episode_id!r} is taken by another episode, in {first}.",
        fix="give each episode its own id",
    )
    return Problem(path, str(error))


def _told(error: Exception) -> str:
    """An unforeseen error in one line, with the place in the code where it came up."""
    place, trace = "", error.__traceback__
    while trace is not None:
        code = trace.tb_frame.f_code
        place, trace = f"{Path(code.co_filename).name}:{trace.tb_lineno}", trace.tb_next
    return f"{type(error).__name__}: {error} ({place})"
