"""Everything that is wrong with stored episodes, in one list."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from safestage_eval._process.within import within_limits
from safestage_eval.doubts.find_doubts import header_contradictions
from safestage_eval.episode import check
from safestage_eval.errors import TraceError

from .discover import discover
from .episode_ref import EpisodeRef


def validate(paths: str | Path | Iterable[str | Path]) -> list[TraceError]:
    """Read every episode under the paths whole and list what is broken; empty when all are sound.

    Beyond the checks made on loading, all columns are read, the content is compared with the
    stored hash, and episode ids must not repeat. Whether what was recorded can be true is for
    ``safestage_eval.audit``.
    """
    try:
        refs = discover(paths)
    except TraceError as error:
        return [error]
    errors = [error for ref in refs for error in validate_episode(ref)]
    ids = Counter(ref.episode_id for ref in refs if ref.episode_id)
    return errors + [
        TraceError(name, f"{count} episodes have this id", fix="give each episode its own id")
        for name, count in ids.items()
        if count > 1
    ]


def validate_episode(ref: EpisodeRef) -> list[TraceError]:
    """List the problems of one stored episode, as ``validate`` does."""
    try:
        with within_limits(ref.shown):
            return _problems(ref)
    except TraceError as error:
        return [error]


def _problems(ref: EpisodeRef) -> list[TraceError]:
    try:
        episode = ref.open(checked=False)
        errors = check(episode)
        errors += [error for error in header_contradictions(episode) if not error.hides]
        if not errors and ref.content_hash not in (None, episode.content_hash):
            errors.append(
                TraceError(
                    ref.shown,
                    f"the content of {ref.episode_id!r} has changed since it was written: its "
                    f"hash is {episode.content_hash[:12]}…, stored is {ref.content_hash[:12]}…",
                    fix="restore the file or record again",
                )
            )
    except TraceError as error:
        return [error]
    return errors
