"""A rate as mean ± sample standard deviation over environment seeds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from statistics import fmean, stdev
from typing import TypeVar

from .rates import Rates, rates

K = TypeVar("K")
Seed = int | str | None
NOTHING = rates(())


@dataclass(frozen=True)
class Group:
    """Outcomes that are reported together, counted by task and environment seed.

    Attributes:
        policy, prompt, stage, family: what they have in common; None where it is any.
        parts: (task, seed) → counts.
        strata: task → the group of tasks within which a bootstrap draws: its stage.
    """

    policy: str | None
    prompt: str | None
    stage: str | None
    family: str | None
    parts: Mapping[tuple[str | None, Seed], Rates]
    strata: Mapping[str | None, str] = field(default_factory=dict)

    @cached_property
    def whole(self) -> Rates:
        """All counts together."""
        return total(self.parts.values())

    @cached_property
    def by_seed(self) -> dict[Seed, Rates]:
        """Seed → counts over all tasks and policies of the group."""
        return self._totals(lambda key: key[1])

    @cached_property
    def by_task(self) -> dict[str | None, Rates]:
        """Task → counts over all seeds and policies of the group."""
        return self._totals(lambda key: key[0])

    def _totals(self, key: Callable[[tuple[str | None, Seed]], K]) -> dict[K, Rates]:
        totals: dict[K, Rates] = {}
        for place, part in self.parts.items():
            totals[key(place)] = totals.get(key(place), NOTHING) + part
        return totals


@dataclass(frozen=True)
class Rate:
    """One rate of one group. All rates of a group are over the same N, so SR = SSR + USR."""

    group: Group
    metric: str
    """SR, SSR, USR or VR."""
    name: str
    """Name in tables: ``ISH-VR`` for the VR of the stage ISH."""

    @property
    def k(self) -> int:
        """Outcomes that count, over all seeds."""
        return self.group.whole.counts[self.metric]

    @property
    def n(self) -> int:
        """Decided outcomes, over all seeds."""
        return self.group.whole.n

    @property
    def per_seed(self) -> dict[Seed, tuple[int, int]]:
        """Seed → (k, n), where anything was decided."""
        cells = self.group.by_seed
        return {seed: (c.counts[self.metric], c.n) for seed, c in cells.items() if c.n}

    @property
    def n_seeds(self) -> int:
        """Environment seeds with a decided outcome."""
        return sum(seed is not None for seed in self.per_seed)

    @property
    def mean(self) -> float | None:
        """Percent: the mean over seeds of the seed's rate; the pooled rate if a seed is unknown.

        None when nothing is decided.
        """
        if not self.n:
            return None
        if None in self.per_seed:
            return 100 * self.k / self.n
        return fmean(self._percents)

    @property
    def std(self) -> float | None:
        """Percentage points: the sample standard deviation (n - 1) of the seeds' rates.

        None with fewer than two seeds or rollouts of a seed, or where a seed is unknown: rates of
        single rollouts are 0 or 100 % and spread by nothing else.
        """
        if None in self.per_seed or self.n_seeds < 2 or self.single_rollouts:
            return None
        return stdev(self._percents)

    @property
    def single_rollouts(self) -> bool:
        """Whether a seed has but one decided outcome."""
        return any(n < 2 for _, n in self.per_seed.values())

    @property
    def _percents(self) -> list[float]:
        """Each seed's rate.

        Percent before anything else: 100 k/n is often exact where k/n is not, so that a deviation
        of just 0.125 is printed as what it is.
        """
        return [100 * k / n for k, n in self.per_seed.values()]

    @property
    def bounds(self) -> tuple[float, float] | None:
        """Percent: the least and the most that k/n could be with every inconclusive one decided."""
        shares = self.group.whole.bounds(self.metric)
        return None if shares is None else (100 * shares[0], 100 * shares[1])

    @property
    def reason(self) -> str:
        """Why the mean or its deviation is missing; empty when neither is."""
        if not self.n:
            if self.group.whole.inconclusive:
                return f"none of {self.group.whole.inconclusive} episodes could be decided"
            if self.group.whole.not_judged:
                return f"none of {self.group.whole.not_judged} episodes was judged"
            return "no episodes"
        if None in self.per_seed:
            return "some episodes name no seed: all are pooled"
        if self.n_seeds < 2:
            return "one seed: no deviation"
        return "a seed has one rollout: no deviation" if self.single_rollouts else ""


def total(parts: Iterable[Rates]) -> Rates:
    """Add up cells."""
    return sum(parts, NOTHING)


def shown(mean: float | None, std: float | None, digits: int = 2) -> str:
    """``52.16 ± 1.43``; a dash for what is not there."""
    return f"{decimal(mean, digits)} ± {decimal(std, digits)}" if mean is not None else "–"


def decimal(value: float | None, digits: int = 2) -> str:
    """A number as tables print it; a dash for None. Minus zero is zero."""
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{value:.{digits}f}"
    return text.lstrip("-") if not text.strip("-0.") else text
