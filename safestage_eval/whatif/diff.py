"""Compare the verdicts of two rule sets on the same traces, and find the parameter behind each flip."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from safestage_eval.formats import EpisodeRef
from safestage_eval.rules import RuleSet, load_bind, load_rules, parse_overrides
from safestage_eval.rules.bind_file import BindFile

from .each_episode import each_episode
from .flip_cause import cause_of
from .judge_again import Again
from .result_difference import Difference, Flip, difference


@dataclass(frozen=True)
class Judged:
    """One episode by both rule sets: the rows that are compared, and its flips with their causes."""

    before: tuple[dict[str, Any], ...]
    after: tuple[dict[str, Any], ...]
    flips: tuple[Flip, ...]


def diff(
    refs: Sequence[EpisodeRef],
    before: Sequence[str | Path],
    after: Sequence[str | Path],
    *,
    overrides: Mapping[str, str] | None = None,
    bind: str | Path | None = None,
    jobs: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Difference:
    """Judge episodes by two rule sets, and say what made each verdict flip.

    Args:
        refs: the episodes.
        before: rule files.
        after: rule files.
        overrides: parameter → value as written, for ``after`` only.
        bind: a bind file, for both.
        jobs: worker processes.
        progress: called with (done, total).

    Raises:
        RuleErrors, RuleError: rules, overrides or a bind file that are not valid.
    """
    old, new = load_rules(list(before)), load_rules(list(after))
    parse_overrides(new, overrides or {})
    work = partial(
        diff_episode,
        before=old,
        after=new,
        overrides=dict(overrides or {}),
        binds=(None, None) if bind is None else (load_bind(bind, old), load_bind(bind, new)),
    )
    judged, problems = each_episode(refs, work, jobs=jobs, progress=progress)
    return difference(
        (row for item in judged for row in item.before),
        (row for item in judged for row in item.after),
        {(flip.episode_id, flip.rule): flip for item in judged for flip in item.flips},
        [problem.message for problem in problems],
    )


def diff_episode(
    ref: EpisodeRef,
    *,
    before: RuleSet,
    after: RuleSet,
    overrides: Mapping[str, str],
    binds: tuple[BindFile | None, BindFile | None],
    usual: Mapping[str, str] | None = None,
) -> Judged:
    """One episode by two rule sets; ``usual``: overrides for ``before``.

    Raises TraceError where it cannot be read.
    """
    episode = ref.open()
    old = Again(episode, before, usual, binds[0])
    new = Again(episode, after, overrides, binds[1], like=old)
    rows, others = ({row["rule"]: row for row in side.judge.result().rows()} for side in (old, new))
    plain = difference(rows.values(), others.values())
    flips = []
    for flip in plain.flips:
        cause = cause_of(old, new, flip.rule, flip.after)
        explained = replace(flip, cause=str(cause), causes=cause.parts)
        flips.append(replace(explained, alternatives=cause.alternatives))
    return Judged(tuple(rows.values()), tuple(others.values()), tuple(flips))
