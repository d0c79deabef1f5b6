"""A share of the episodes for a quick look, spread over stages, tasks and policies."""

from __future__ import annotations

import hashlib
import heapq
from collections.abc import Iterable
from typing import NamedTuple

from safestage_eval.formats import EpisodeRef

STRATA = ("stage", "task", "policy")


class Sample(NamedTuple):
    """The chosen ones in the order in which they came, and in words what share they are."""

    refs: list[EpisodeRef]
    told: str


def sample(refs: Iterable[EpisodeRef], count: int, seed: int = 0) -> Sample:
    """``count`` episodes, so many of each stage × task × policy as in proportion to all of them.

    The same ones whenever seed, count and episodes are the same, in whatever order these come:
    within a group those are taken whose ids have the least digests. Shares are rounded by largest
    remainder. Files that cannot be read are a group of their own.
    """
    kept: dict[tuple[str, ...], list[tuple[int, int, EpisodeRef]]] = {}
    sizes: dict[tuple[str, ...], int] = {}
    for number, ref in enumerate(refs):
        group = tuple(str(ref.fields.get(name)) for name in STRATA)
        sizes[group] = sizes.get(group, 0) + 1
        # the heap's least is the largest digest, which goes first
        item = -_digest(ref, seed), -number, ref
        heap = kept.setdefault(group, [])
        if len(heap) < count:
            heapq.heappush(heap, item)
        else:
            heapq.heappushpop(heap, item)
    total = sum(sizes.values())
    shares = _shares(sizes, min(count, total), total)
    chosen = [
        (-number, ref)
        for group, heap in kept.items()
        for _, number, ref in heapq.nlargest(shares[group], heap, key=lambda item: item[:2])
    ]
    chosen.sort(key=lambda item: item[0])
    told = ""
    if total > count:
        told = (
            f"a sample: {count:,} of {total:,} episodes, spread over {len(sizes):,} groups of stage, "
            f"task and policy (seed {seed})"
        )
    return Sample([ref for _, ref in chosen], told)


def _shares(
    sizes: dict[tuple[str, ...], int], count: int, total: int
) -> dict[tuple[str, ...], int]:
    """How many of each group; they add up to ``count``."""
    shares = {group: size * count // total for group, size in sizes.items()} if total else {}
    left = count - sum(shares.values())
    by_rest = sorted(sizes, key=lambda group: (-(sizes[group] * count % total), group))
    for group in by_rest[:left]:
        shares[group] += 1
    return shares


def _digest(ref: EpisodeRef, seed: int) -> int:
    text = f"{seed} {ref.episode_id or ref.path}"
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "big")
