"""Statistical power: whether a sample supports a claim about a difference, and how many rollouts would."""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import NormalDist

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
