"""A whole run: found, chosen, judged by an engine, kept, and given back in order."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from itertools import chain, islice
from pathlib import Path
from typing import Any

from safestage_eval.formats import EpisodeRef
from safestage_eval.formats.discover import find
from safestage_eval.formats.episode_filter import Selection

from .bind_checks import require_match
from .gates import Gates
from .score_many import score_many
from .scores import Scores, deduplicate, titles
from .settings import Settings, load_settings
from .stratified_sample import sample

IN_MEMORY = 1000
"""Results that are held; those of a longer run go to disk at once."""

Tell = Callable[[int, int | None], None]


@dataclass(frozen=True)
class Choice:
    """Which episodes, and where and how they are judged.

    Attributes:
        where: header field → wanted value.
        sample: judge only so many, spread over stages, tasks and policies; None: all.
        seed: of the sample.
        resume: folder that keeps finished results; None: none is kept.
        engine: ``local`` or ``ray``.
        address: of the Ray cluster; None: the one of this environment, or a new one right here.
        jobs: worker processes; None: one per processor.
    """

    where: Mapping[str, str] | None = None
    sample: int | None = None
    seed: int = 0
    resume: Path | None = None
    engine: str = "local"
    address: str | None = None
    jobs: int | None = None


def score_traces(
    traces: Sequence[str | Path],
    settings: Settings,
    choice: Choice | None = None,
    progress: Tell | None = None,
) -> Scores:
    """Judge what is found under the paths.

    A short run is held in memory. Of a long one, or one that is to be resumed, each result goes to
    disk when it is reached, and a run that was killed goes on after the last that it wrote.

    Args:
        traces: files and folders.
        settings: from ``load_settings``.
        choice: which episodes, and where.
        progress: called with (done, total) after each episode; total is None as long as it is not known.

    Raises:
        TraceError: nothing was found.
        InputError: nothing matches ``where`` or the bind file, or results cannot be written.
    """
    choice = choice or Choice()
    if settings.bind is not None:
        require_match(settings.bind, Selection(find(traces), choice.where))
    chosen = Selection(find(traces), choice.where)
    refs, note = iter(chosen), ""
    if choice.sample is not None:
        picked = sample(refs, choice.sample, choice.seed)
        refs, note = iter(picked.refs), picked.told
    held = None
    if choice.resume is None and choice.engine == "local":
        first = list(islice(refs, IN_MEMORY + 1))
        refs = chain(first, refs)
        held = first if len(first) <= IN_MEMORY else None
    if held is not None:
        scores = _in_memory(held, settings, choice.jobs, progress)
    else:
        scores = _on_disk(refs, settings, choice, progress)
    left_out = dict.fromkeys(chosen.aborted)
    for result in scores.results if left_out else ():
        left_out.pop(result.episode_id, None)  # it was tried again
    return replace(scores, sample=note, aborted=tuple(left_out), gates=Gates.of(settings.rules))


def score_paths(
    traces: Iterable[str | Path],
    rules: Sequence[str | Path] = (),
    *,
    where: Mapping[str, str] | None = None,
    jobs: int | None = None,
    progress: Tell | None = None,
    **asked: Any,
) -> Scores:
    """``score_traces`` by rules as they are named: all built-in ones if empty.

    ``asked``: the other arguments of ``load_settings``, whose errors it raises too.
    """
    from safestage_eval.rules import builtin_names

    settings = load_settings(list(rules) or builtin_names(), **asked)
    return score_traces(list(traces), settings, Choice(where, jobs=jobs), progress)


def _in_memory(
    refs: Sequence[EpisodeRef], settings: Settings, jobs: int | None, progress: Tell | None
) -> Scores:
    results, problems, copies = deduplicate(
        score_many(refs, settings=settings, jobs=jobs, progress=progress)
    )
    return Scores(tuple(results), tuple(problems), titles(settings.rule_set), tuple(copies))


def _on_disk(
    refs: Iterable[EpisodeRef], settings: Settings, choice: Choice, progress: Tell | None
) -> Scores:
    from .run_ledger import Ledger

    keys = None
    if choice.resume is not None:  # else nobody asks
        from .result_keys import Keys

        keys = Keys(settings)
    ledger = Ledger(choice.resume, keys, progress)
    try:
        if choice.engine == "ray":
            from .ray_cluster import judged

            with redirect_stdout(sys.stderr):  # where Ray tells of processes that died
                for number, result in judged(ledger.todo(refs), settings, choice.address):
                    ledger.note(number, result)
        else:
            from .pool import Local

            with Local(choice.jobs or os.cpu_count() or 1, settings, lines=True) as engine:
                for number, result in engine.run(ledger.todo(refs)):
                    ledger.note(number, result)
    finally:
        ledger.flush()
    return ledger.scores(titles(settings.rule_set))
