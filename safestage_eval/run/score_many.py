"""Judge episodes in this process or in several; results stay in memory."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from safestage_eval._process.children import WORTH_A_POOL
from safestage_eval.formats import EpisodeRef
from safestage_eval.verdicts.problem import Problem

from .bind_checks import require_match
from .score_episode import score_episode
from .settings import Settings, load_settings

if TYPE_CHECKING:
    from safestage_eval.verdicts import EpisodeResult


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
        progress: called with (done, total) after each episode.
        settings: from ``load_settings``, instead of rules and what follows.
        asked: the other arguments of ``load_settings``.

    Raises:
        RuleErrors, RuleError, InputError: as ``load_settings``, and a bind file that matches none of
            the episodes.
    """
    settings = settings or load_settings(rules, **asked)
    require_match(settings.bind, refs)
    workers = min(jobs or os.cpu_count() or 1, len(refs))
    several = workers > 1 and (jobs is not None or len(refs) >= WORTH_A_POOL)
    if refs and (several or settings.timeout is not None or settings.memory is not None):
        results = _in_processes(refs, settings, workers if several else 1, progress)
    else:
        results = []
        for ref in refs:
            results.append(score_episode(ref, settings.rule_set, **settings.arguments()))
            if progress is not None:
                progress(len(results), len(refs))
    return results


def _in_processes(
    refs: Sequence[EpisodeRef],
    settings: Settings,
    workers: int,
    progress: Callable[[int, int], None] | None,
) -> list[EpisodeResult | Problem]:
    from .pool import Local

    by_number: dict[int, Any] = {}
    with Local(workers, settings) as engine:
        for number, result in engine.run(enumerate(refs)):
            by_number[number] = result
            if progress is not None:
                progress(len(by_number), len(refs))
    return [by_number[number] for number in range(len(refs))]
