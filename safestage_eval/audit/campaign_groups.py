"""Groups of episodes, and comparisons between them, that checks of an evaluation share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeVar

import numpy as np

from .campaign_summary import Campaign, Summary

K = TypeVar("K")

SAME = 1e-4
"""m, and parts of a quaternion: initial states that differ by less are the same."""

OTHER = 2e-3
"""m, and parts of a quaternion: initial states that differ by more are different."""


def groups(episodes: Iterable[Summary], key: Callable[[Summary], K]) -> dict[K, list[Summary]]:
    """Key → episodes, in their order."""
    grouped: dict[K, list[Summary]] = {}
    for one in episodes:
        grouped.setdefault(key(one), []).append(one)
    return grouped


def ids(episodes: Iterable[Summary]) -> tuple[str, ...]:
    """Their ids."""
    return tuple(one.episode_id for one in episodes)


def policies(campaign: Campaign) -> dict[tuple[str, str], list[Summary]]:
    """(policy, prompt) → episodes; ``–`` where a header names none."""
    return groups(campaign.episodes, lambda one: (one.policy or "–", one.prompt or "–"))


def label(name: tuple[str, str]) -> str:
    """A policy and its prompt in words."""
    policy, prompt = name
    return policy if prompt == "–" else f"{policy} ({prompt})"


def apart(one: Summary, other: Summary) -> tuple[float, str] | None:
    """How far two initial states are apart: the largest difference, and whose it is.

    Over positions (m) and quaternions of the bodies that both have; a quaternion and its negative are
    the same turn. None where they have no body in common.
    """
    first, second = dict(one.start), dict(other.start)
    common = [name for name in first if name in second]
    if not common:
        return None
    a = np.array([first[name] for name in common])
    b = np.array([second[name] for name in common])
    sign = np.where((a[:, 3:] * b[:, 3:]).sum(1, keepdims=True) < 0, -1.0, 1.0)
    gap = np.maximum(np.abs(a[:, :3] - b[:, :3]).max(1), np.abs(a[:, 3:] - sign * b[:, 3:]).max(1))
    worst = int(gap.argmax())
    return float(gap[worst]), common[worst]


def alike(episodes: Sequence[Summary]) -> list[list[Summary]]:
    """Episodes whose initial states are the same, together; in order of their first ones.

    Takes no square of their number: only those are compared whose mean positions are close.
    """
    means = np.array([_middle(one) for one in episodes])
    first = list(range(len(episodes)))
    order = np.argsort(means, kind="stable")
    for place, here in enumerate(order):
        for there in order[place + 1 :]:
            if not means[there] - means[here] <= SAME:
                break
            one, other = episodes[here], episodes[there]
            gap = apart(one, other) if len(one.start) == len(other.start) else None
            if gap is not None and gap[0] <= SAME:
                first[there] = first[here] = min(first[here], first[there])
    clusters: dict[int, list[Summary]] = {}
    for index, one in zip(first, episodes, strict=True):
        clusters.setdefault(index, []).append(one)
    return [*clusters.values()]


def _middle(one: Summary) -> float:
    """m, the mean of all positions in the first frame."""
    return float(np.mean([pose[:3] for _, pose in one.start])) if one.start else float("nan")


def twins(episodes: Sequence[Summary], limit: float) -> Iterator[tuple[Summary, Summary]]:
    """Pairs in which all bodies were at the same places (m, ``limit``) at the same shares of the time.

    Compares only those whose bodies are equally many and whose mean places are close, so that it takes
    no square of their number.
    """
    for some in groups((e for e in episodes if e.waypoints), lambda e: len(e.waypoints)).values():
        means = np.array([float(one.places.astype(np.float64).mean()) for one in some])
        order = np.argsort(means, kind="stable")
        for i, here in enumerate(order):
            for there in order[i + 1 :]:
                if means[there] - means[here] > limit:
                    break
                one, other = some[min(here, there)], some[max(here, there)]
                close = abs(one.duration - other.duration) <= limit * 10
                if close and float(np.abs(one.places - other.places).max()) <= limit:
                    yield one, other
