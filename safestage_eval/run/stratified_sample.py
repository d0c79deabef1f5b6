"""A share of the episodes for a quick look, spread over stages, policies and tasks."""

from __future__ import annotations

import hashlib
import heapq
from collections.abc import Iterable, Mapping
from typing import NamedTuple

from safestage_eval.formats import EpisodeRef

Group = tuple[str, ...]

STRATA = ("stage", "policy", "task")
"""Names of a group, from the one that is spread over first."""


class Sample(NamedTuple):
    """The chosen ones in the order in which they came, and in words what share they are."""

    refs: list[EpisodeRef]
    told: str


def sample(refs: Iterable[EpisodeRef], count: int, seed: int = 0) -> Sample:
    """``count`` episodes: of each stage, in it of each policy, in that of each task, in proportion.

    The same ones whenever seed, count and episodes are the same, in whatever order these come:
    within a group those are taken whose ids have the least digests. Shares are rounded by largest
    remainder, and where remainders are equal, as they are of few episodes out of many groups, the
    seed decides. Files that cannot be read are a group of their own.
    """
    kept: dict[Group, list[tuple[int, int, EpisodeRef]]] = {}
    sizes: dict[Group, int] = {}
    for number, ref in enumerate(refs):
        group = tuple(str(ref.fields.get(name)) for name in STRATA)
        sizes[group] = sizes.get(group, 0) + 1
        # the heap's least is the largest digest, which goes first
        item = -_digest(f"{seed} {ref.episode_id or ref.shown}"), -number, ref
        heap = kept.setdefault(group, [])
        if len(heap) < count:
            heapq.heappush(heap, item)
        else:
            heapq.heappushpop(heap, item)
    total = sum(sizes.values())
    shares = _shares(sizes, min(count, total), seed)
    chosen = [
        (-number, ref)
        for group, heap in kept.items()
        for _, number, ref in heapq.nlargest(shares[group], heap, key=lambda item: item[:2])
    ]
    chosen.sort(key=lambda item: item[0])
    note = ""
    if total > count:
        groups = sum(map(bool, shares.values()))
        note = (
            f"a sample: {count:,} of {total:,} episodes, from {groups:,} of {len(sizes):,} groups of "
            f"stage, policy and task (seed {seed})"
        )
    return Sample([ref for _, ref in chosen], note)


def _shares(sizes: Mapping[Group, int], count: int, seed: int, level: int = 0) -> dict[Group, int]:
    """How many of each group; they add up to ``count``, for each first ``level`` names that agree."""
    if len(sizes) == 1:
        return dict.fromkeys(sizes, count)
    parts: dict[Group, dict[Group, int]] = {}
    for group, size in sizes.items():
        parts.setdefault(group[: level + 1], {})[group] = size
    totals = {name: sum(part.values()) for name, part in parts.items()}
    total = sum(totals.values())
    shares = {name: size * count // total for name, size in totals.items()}
    by_rest = sorted(
        totals, key=lambda name: (-(totals[name] * count % total), _digest(f"{seed} {name}"))
    )
    for name in by_rest[: count - sum(shares.values())]:
        shares[name] += 1
    counts: dict[Group, int] = {}
    for name, part in parts.items():
        counts |= _shares(part, shares[name], seed, level + 1)
    return counts


def _digest(text: str) -> int:
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")
