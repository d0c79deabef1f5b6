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
    within a group those are taken whose ids have the least digests. Which groups get what is left of
    rounding, the seed decides. Files that cannot be read are a group of their own.
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


def _shares(sizes: Mapping[Group, int], count: int, seed: int) -> dict[Group, int]:
    """How many of each group: every so many-th episode of all, the groups one after the other.

    So they are in proportion for all groups together whose first names agree, too.
    """
    total, end = sum(sizes.values()), 0
    first = _digest(str(seed)) % max(total, 1)
    shares = {}
    for group in sorted(sizes):
        begin, end = end, end + sizes[group]
        shares[group] = (end * count + first) // total - (begin * count + first) // total
    return shares


def _digest(text: str) -> int:
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")
