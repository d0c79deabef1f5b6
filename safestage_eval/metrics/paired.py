"""Paired counts of two sets of outcomes on the same rollouts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr

from safestage_eval.errors import InputError

from .interval import RESAMPLES, in_strata, percentiles, sizes, weights, wilson
from .outcome import Outcome
from .rates import METRICS, counted, stage_order

By = Literal["policy", "prompt", "rules"]

KEYS: dict[By, tuple[str, ...]] = {
    "policy": ("task", "prompt", "seed", "rollout"),
    "prompt": ("task", "policy", "seed", "rollout"),
    "rules": ("task", "policy", "prompt", "seed", "rollout"),
}
"""Compared field → the fields that the two rollouts of a pair share."""


@dataclass(frozen=True)
class Pairs:
    """Rollouts of both sides that belong together.

    Attributes:
        by: the field that differs between the sides.
        both: (of A, of B), decided on both sides: the N of every rate.
        undecided: pairs with a side that was judged but not decided.
        not_judged: pairs with a side that no assigned rule judged.
        alone: rollouts of A and of B without a partner.
    """

    by: By
    both: tuple[tuple[Outcome, Outcome], ...]
    undecided: tuple[tuple[Outcome, Outcome], ...]
    not_judged: int
    alone: tuple[tuple[Outcome, ...], tuple[Outcome, ...]]


def pairs(a: Iterable[Outcome], b: Iterable[Outcome], by: By) -> Pairs:
    """Match rollouts by task, seed and rollout, and by whatever else is not compared.

    Raises:
        InputError: nothing belongs together.
    """
    first, second = ({_key(o, by): o for o in side} for side in (a, b))
    common = [key for key in first if key in second]
    if not common:
        raise InputError(
            "both sides", f"no rollout of one is there in the other ({', '.join(KEYS[by])}).",
            fix="compare results of the same tasks, seeds and rollouts",
        )  # fmt: skip
    matched = [(first[key], second[key]) for key in common]
    judged = [pair for pair in matched if all(o.judged for o in pair)]
    return Pairs(
        by,
        tuple(pair for pair in judged if all(o.decided for o in pair)),
        tuple(pair for pair in judged if not all(o.decided for o in pair)),
        len(matched) - len(judged),
        (
            tuple(o for key, o in first.items() if key not in second),
            tuple(o for key, o in second.items() if key not in first),
        ),
    )


@dataclass(frozen=True)
class Paired:
    """One metric on both sides, over the same pairs.

    Attributes:
        scope: ``All``, a stage or a family.
        level: which of these: ``all``, ``stage``, ``family``.
        metric: SR, SSR, USR or VR.
        tasks: task → (pairs, k of A, k of B, only A, only B).
        stages: task → stage.
        least, most: of the difference, 0…1, whatever the undecided pairs are; None without pairs.
    """

    scope: str
    level: str
    metric: str
    tasks: Mapping[str | None, tuple[int, int, int, int, int]]
    stages: Mapping[str | None, str] = field(default_factory=dict)
    least: float | None = None
    most: float | None = None

    @cached_property
    def sums(self) -> tuple[int, int, int, int, int]:
        """N, k of A, k of B, pairs in which only A counts, and only B."""
        columns = zip(*self.tasks.values(), strict=True) if self.tasks else [()] * 5
        n, k_a, k_b, only_a, only_b = map(sum, columns)
        return n, k_a, k_b, only_a, only_b

    @property
    def n(self) -> int:
        """Pairs."""
        return self.sums[0]

    @property
    def difference(self) -> float | None:
        """Rate of B minus rate of A, -1…1; None without pairs."""
        n, k_a, k_b, _, _ = self.sums
        return (k_b - k_a) / n if n else None

    @property
    def p(self) -> float | None:
        """McNemar's exact test, two-sided; None without pairs."""
        return mcnemar(*self.sums[3:]) if self.n else None

    def resampled(self, seed: int, resamples: int) -> NDArray[np.float64] | None:
        """(B, 2): k of B - k of A, and pairs, over resampled tasks; None with one task."""
        if not self.n or len(self.tasks) < 2:
            return None
        order = in_strata(self.stages)
        counts = np.array([self.tasks[task] for task in order], dtype=float)
        sums = np.stack([counts[:, 2] - counts[:, 1], counts[:, 0]], axis=1)
        drawn: NDArray[np.float64] = weights(sizes(self.stages), seed, resamples) @ sums
        return drawn

    def bootstrap(self, seed: int = 0, resamples: int = RESAMPLES) -> tuple[float, float] | None:
        """Percentile interval of the difference over resampled tasks, with all their pairs.

        As ``interval.bootstrap``. None with fewer than two tasks.
        """
        drawn = self.resampled(seed, resamples)
        return None if drawn is None else percentiles(drawn[:, 0], drawn[:, 1])

    def interval(self, seed: int = 0, resamples: int = RESAMPLES) -> tuple[float, float] | None:
        """``bootstrap``'s interval; ``newcombe``'s where all tasks differ alike, so that it has no width."""
        interval = self.bootstrap(seed, resamples)
        return newcombe(*self.sums) if interval and interval[0] == interval[1] else interval


def newcombe(n: int, k_a: int, k_b: int, only_a: int, only_b: int) -> tuple[float, float]:
    """Hybrid score interval of the difference of two paired rates, B minus A, -1…1.

    It takes every pair as independent of the others. Source: R. G. Newcombe, "Improved confidence
    intervals for the difference between binomial proportions based on paired data", Statistics in
    Medicine 17, 1998, method 10.

    Args:
        n: pairs, at least one.
        k_a: in how many of them A counts.
        k_b: in how many B counts.
        only_a: in how many only A counts.
        only_b: in how many only B counts.
    """
    (low_a, high_a), (low_b, high_b) = (wilson(k, n) or (0, 1) for k in (k_a, k_b))
    margins = k_a * (n - k_a) * k_b * (n - k_b)
    cross: float = (k_a - only_a) * (n - k_a - only_b) - only_a * only_b
    if cross > 0:
        cross = max(cross - n / 2, 0)
    together = cross / math.sqrt(margins) if margins else 0.0
    a, b = k_a / n, k_b / n

    def reach(one: float, other: float) -> float:
        return math.sqrt(max(one**2 - 2 * together * one * other + other**2, 0.0))

    return b - a - reach(b - low_b, high_a - a), b - a + reach(high_b - b, a - low_a)


def mcnemar(only_a: int, only_b: int) -> float:
    """McNemar's exact test: P of a split at least as uneven, if either side were as likely.

    Twice the lower tail of the binomial distribution with p = 1/2, at most 1. Source: A. Agresti,
    "Categorical Data Analysis", 3rd edition, section 11.1.
    """
    return min(1.0, 2 * float(bdtr(min(only_a, only_b), only_a + only_b, 0.5)))


def holm(values: Sequence[float]) -> list[float]:
    """P values adjusted for being several (S. Holm, Scand. J. Statistics 6, 1979)."""
    order = sorted(range(len(values)), key=lambda i: values[i])
    result, worst = [0.0] * len(values), 0.0
    for rank, i in enumerate(order):
        worst = max(worst, min(1.0, (len(values) - rank) * values[i]))
        result[i] = worst
    return result


def paired(matched: Pairs) -> list[Paired]:
    """Count every metric over all pairs, then by stage, then by family."""
    scopes: list[tuple[str, str, Callable[[Outcome], bool]]] = [("All", "all", lambda _: True)]
    every = [pair[0] for pair in (*matched.both, *matched.undecided)]
    stages = sorted({o.stage for o in every}, key=stage_order)
    if len(stages) > 1:
        scopes += [(stage, "stage", _holds(stage=stage)) for stage in stages]
    families = {(o.stage, o.family) for o in every if o.family is not None}
    if len(families) > 1:
        scopes += [
            (str(family), "family", _holds(stage=stage, family=family))
            for stage, family in sorted(families, key=lambda f: (stage_order(f[0]), str(f[1])))
        ]
    return [
        _count(matched, scope, level, metric, inside)
        for scope, level, inside in scopes
        for metric in METRICS
    ]


def _count(
    matched: Pairs, scope: str, level: str, metric: str, inside: Callable[[Outcome], bool]
) -> Paired:
    tasks: dict[str | None, list[int]] = {}
    stages: dict[str | None, str] = {}
    least = most = 0
    for pair in matched.both:
        if inside(pair[0]):
            a, b = (min(counted(o, metric)) for o in pair)
            sums = tasks.setdefault(pair[0].task, [0] * 5)
            stages[pair[0].task] = pair[0].stage
            for i, value in enumerate((1, a, b, a and not b, b and not a)):
                sums[i] += value
            least, most = least + b - a, most + b - a
    open_ones = [pair for pair in matched.undecided if inside(pair[0])]
    for pair in open_ones:
        a_cases, b_cases = (counted(o, metric) for o in pair)
        least += min(b_cases) - max(a_cases)
        most += max(b_cases) - min(a_cases)
    total = sum(sums[0] for sums in tasks.values()) + len(open_ones)
    return Paired(
        scope,
        level,
        metric,
        {task: (s[0], s[1], s[2], s[3], s[4]) for task, s in tasks.items()},
        stages,
        least / total if total else None,
        most / total if total else None,
    )


def _holds(**fields: str | None) -> Callable[[Outcome], bool]:
    return lambda o: all(getattr(o, name) == value for name, value in fields.items())


def _key(o: Outcome, by: By) -> tuple[object, ...]:
    key = tuple(getattr(o, name) for name in KEYS[by])
    return (o.episode_id,) if by == "rules" and None in key and o.episode_id else key
