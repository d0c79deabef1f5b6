"""Sample sizes that show a difference between two independent rates."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from .power import ALPHA, POWER

EXACT = 400
"""Rollouts of a policy up to which power is summed up exactly; beyond, by the normal approximation."""

STEPS = 20
"""Halvings of the difference: to a millionth."""


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
    i, j = np.arange(n + 1)[:, None], np.arange(m + 1)[None]
    pooled_rate = (i + j) / (n + m)
    spread = np.sqrt(pooled_rate * (1 - pooled_rate) * (1 / n + 1 / m))
    significant = np.abs(i / n - j / m) > _z(1 - ALPHA / 2) * spread + 1e-12
    return float(_binomial(n, first) @ significant @ _binomial(m, second))


def _binomial(n: int, rate: float) -> NDArray[np.float64]:
    """(n + 1,) how probable each number of successes is."""
    if rate in (0.0, 1.0):
        return np.asarray(np.eye(n + 1)[round(rate * n)], np.float64)
    k = np.arange(n + 1)
    logs = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, n + 1)))])  # of factorials
    log = logs[n] - logs[k] - logs[n - k] + k * np.log(rate) + (n - k) * np.log1p(-rate)
    return np.asarray(np.exp(log))


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

    low, high = 0.0, 1.0
    if power(high) < POWER:
        return None
    for _ in range(STEPS):
        half = (low + high) / 2
        low, high = (low, half) if power(half) >= POWER else (half, high)
    return high


def _z(share: float) -> float:
    return NormalDist().inv_cdf(share)
