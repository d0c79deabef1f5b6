"""Confidence intervals of a rate: Wilson's, and a bootstrap over tasks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from .seeds import Rate

CONFIDENCE = 0.95
RESAMPLES = 2000


def wilson(k: int, n: int, confidence: float = CONFIDENCE) -> tuple[float, float] | None:
    """Wilson's score interval of a proportion, 0…1; None when n is 0.

    It takes every rollout as independent of the others. Source: E. B. Wilson, "Probable inference,
    the law of succession, and statistical inference", JASA 22, 1927.
    """
    if not n:
        return None
    z = NormalDist().inv_cdf(0.5 + confidence / 2)
    p, shrink = k / n, 1 + z * z / n
    centre = (p + z * z / (2 * n)) / shrink
    half = z / shrink * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    return (0.0 if k == 0 else centre - half), (1.0 if k == n else centre + half)


def bootstrap(rate: Rate, seed: int = 0, resamples: int = RESAMPLES) -> tuple[float, float] | None:
    """Percentile interval of k/n, 0…1, over tasks resampled with replacement.

    A task brings all of its rollouts along, because those of one task are alike. Tasks are drawn
    within their stage, so that every resample has as many of each stage. None with fewer than two
    tasks, or when nothing is decided. Source: A. C. Davison and D. V. Hinkley, "Bootstrap Methods
    and their Application", 1997, section 3.8.
    """
    cells = rate.group.by_task
    tasks = in_strata(rate.group.strata)
    if not rate.n or len(tasks) < 2:
        return None
    counts = np.array([[cells[t].counts[rate.metric], cells[t].n] for t in tasks], dtype=float)
    drawn = weights(sizes(rate.group.strata), seed, resamples) @ counts
    return percentiles(drawn[:, 0], drawn[:, 1])


def percentiles(
    above: NDArray[np.float64], below: NDArray[np.float64]
) -> tuple[float, float] | None:
    """Take the middle share of the ratios of two (B,) sums; resamples without a denominator drop out."""
    some = below > 0
    if not some.any():
        return None
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(above[some] / below[some], [tail, 1 - tail])
    return float(low), float(high)


def in_strata(stages: Mapping[str | None, str]) -> list[str | None]:
    """Sort tasks by stage, then name: the order in which they are drawn."""
    return sorted(stages, key=lambda task: (stages[task], str(task)))


def sizes(stages: Mapping[str | None, str]) -> tuple[int, ...]:
    """Tasks per stage, in the order of ``in_strata``."""
    names = sorted(stages.values())
    return tuple(names.count(name) for name in sorted(set(names)))


@lru_cache(maxsize=64)
def weights(strata: Sequence[int], seed: int, resamples: int) -> NDArray[np.float64]:
    """(B, tasks): how often each task is drawn in each resample, the same for the same seed."""
    random = np.random.default_rng(seed)
    drawn = [random.multinomial(size, [1 / size] * size, resamples) for size in strata]
    return np.concatenate(drawn, axis=1).astype(float)
