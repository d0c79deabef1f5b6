"""Statistical power: whether a sample supports a claim about a difference, and which sample would."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from .interval import RESAMPLES
from .paired import Paired

ALPHA = 0.05
POWER = 0.80


@dataclass(frozen=True)
class Need:
    """Sample size that shows the observed difference four times out of five (power 0.8).

    Attributes:
        pairs: independent pairs that would do; None if no difference was observed.
        per_task: pairs per task that would do on these tasks; None if no number would.
        tasks: tasks that would do with as many pairs each as there are.
        smallest: the difference, 0…1, that this sample would show four times out of five.
        alike: the correlation between pairs of one task, 0…1.
    """

    pairs: int | None
    per_task: int | None
    tasks: int | None
    smallest: float
    alike: float


def need(paired: Paired, seed: int = 0, resamples: int = RESAMPLES) -> Need | None:
    """Estimate the sample size from the discordant pairs and the differences between tasks; None without discordant pairs.

    The number of pairs is that of McNemar's test (R. J. Connor, Biometrics 43, 1987). Pairs of one
    task are alike, so m of them are worth m / (1 + (m - 1) r), where r is their correlation
    (L. Kish, "Survey Sampling", 1965, section 5.4), here from the bootstrap over tasks.
    """
    n, _, _, only_a, only_b = paired.sums
    if not only_a + only_b:
        return None
    discordant, difference = (only_a + only_b) / n, (only_b - only_a) / n
    per_task = n / len(paired.tasks)
    alike = _alike(paired, discordant - difference**2, per_task, seed, resamples)
    effect = 1 + (per_task - 1) * alike
    smallest = (_z(1 - ALPHA / 2) + _z(POWER)) * math.sqrt(discordant * effect / n)
    if not difference:
        return Need(None, None, None, smallest, alike)
    wanted = connor(discordant, difference)
    left = len(paired.tasks) - wanted * alike
    return Need(
        math.ceil(wanted),
        math.ceil(wanted * (1 - alike) / left) if left > 0 else None,
        math.ceil(wanted * effect / per_task),
        smallest,
        alike,
    )


def connor(discordant: float, difference: float) -> float:
    """Independent pairs that McNemar's test needs, two-sided at ``ALPHA``, with power ``POWER``.

    Args:
        discordant: share of the pairs in which just one side counts.
        difference: between the two rates; not 0.
    """
    spread = math.sqrt(max(discordant - difference**2, 0.0))
    return ((_z(1 - ALPHA / 2) * math.sqrt(discordant) + _z(POWER) * spread) / difference) ** 2


def _alike(paired: Paired, variance: float, per_task: float, seed: int, resamples: int) -> float:
    """The correlation within tasks that makes the bootstrap as wide as it is."""
    drawn = paired.resampled(seed, resamples)
    if drawn is None or per_task <= 1 or variance <= 0:
        return 0.0
    some = drawn[drawn[:, 1] > 0]
    effect = float((some[:, 0] / some[:, 1]).var()) / (variance / paired.n)
    return min(1.0, max(0.0, (effect - 1) / (per_task - 1)))


def _z(share: float) -> float:
    return NormalDist().inv_cdf(share)


EXACT = 400
"""Rollouts of a policy up to which power is summed up exactly; beyond, by the normal approximation."""


def power_of(n: int, m: int, first: float, second: float) -> float:
    """How often the pooled two-sided z test (5 %) finds that two rates differ.

    Args:
        n: rollouts of the one.
        m: of the other; all independent.
        first: true rate of the one, 0…1.
        second: of the other.
    """
    if max(n, m) > EXACT:
        centre = (n * first + m * second) / (n + m)
        pooled = math.sqrt(centre * (1 - centre) * (1 / n + 1 / m))
        own = math.sqrt(first * (1 - first) / n + second * (1 - second) / m)
        beyond = abs(first - second) - _z(1 - ALPHA / 2) * pooled
        return NormalDist().cdf(beyond / own) if own > 0 else float(beyond > 0)
    from scipy.stats import binom

    i, j = np.arange(n + 1)[:, None], np.arange(m + 1)[None]
    pooled_rate = (i + j) / (n + m)
    spread = np.sqrt(pooled_rate * (1 - pooled_rate) * (1 / n + 1 / m))
    significant = np.abs(i / n - j / m) > _z(1 - ALPHA / 2) * spread + 1e-12
    chances = (binom.pmf(np.arange(k + 1), k, rate) for k, rate in ((n, first), (m, second)))
    of_first, of_second = chances
    return float(of_first @ significant @ of_second)


def smallest_difference(n: int, m: int, centre: float) -> float | None:
    """The difference between two rates that a test finds four times out of five (power 0.8).

    Args:
        n: rollouts of the one policy; all independent.
        m: of the other.
        centre: the rate that lies in the middle between them, 0…1; moved towards 0.5 where there is
            no room for the difference on both sides.

    Returns:
        0…1; None where even 0 against 1 would not be found.
    """

    def power(difference: float) -> float:
        middle = min(max(centre, difference / 2), 1 - difference / 2)
        return power_of(n, m, middle - difference / 2, middle + difference / 2)

    from scipy.optimize import brentq

    if power(1.0) < POWER:
        return None
    return float(brentq(lambda difference: power(difference) - POWER, 0.0, 1.0, xtol=1e-6))
