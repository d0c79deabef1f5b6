"""A parameter that may have any value of a range: what is compared with it is true, false or open.

The evaluator takes uncertain measurements, and an uncertain limit is no different: where a comparison comes
out alike for every value of a range, its truth is certain (interval analysis: Moore, "Interval Analysis",
1966). Whoever needs one value, an option of a measurement or how long a state has to last, is told nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from safestage_eval.evidence.intervals import F64, Bool, Interval, hide
from safestage_eval.geometry.gjk import PROMISED

ROUNDING = 2 * PROMISED
"""M, by which a distance that is measured for another limit may differ."""


class Undecided(Exception):  # noqa: N818 - it is no error
    """Raised where a range stands for a value that is needed exactly."""


class Seen:
    """What the ranges of one parameter were needed for.

    Attributes:
        values: (T,) each, of signals that they were compared with.
        exactly: whether for anything else, too.
    """

    def __init__(self) -> None:
        """Nothing yet."""
        self.values: list[F64] = []
        self.exactly = False


class Range(NamedTuple):
    """All values of a parameter, or of what is as far below 0, from ``low`` to ``high``, both included.

    Attributes:
        low, high: SI.
        reach: m, up to where distances are measured.
        seen: what it is compared with is noted there.
    """

    low: float
    high: float
    reach: float
    seen: Seen

    def __neg__(self) -> Range:
        return Range(-self.high, -self.low, -self.reach, self.seen)

    def __abs__(self) -> float:
        return abs(self.reach)

    def __float__(self) -> float:
        return self.reach

    def margin(self, series: Interval, op: str) -> Interval:
        """Whether a signal keeps the limit under all values, under some or under none."""
        sign = -1.0 if self.high < 0 or self.low < 0 else 1.0
        self.seen.values += [sign * series.lower, sign * series.upper]
        test, up = _TESTS[op], op[0] == ">"
        easy, hard = (self.low, self.high) if up else (self.high, self.low)
        worst, best = (series.lower, series.upper) if up else (series.upper, series.lower)
        margin = open_truth(test(best, easy), test(worst, hard))
        return margin if series.known.all() else hide(margin, ~series.known)


def open_truth(possible: Bool, sure: Bool | None = None) -> Interval:
    """A truth that a range leaves open: there its ends are ±1, for ±∞ is what was not recorded."""
    sure = np.zeros_like(possible) if sure is None else sure
    lower = np.where(sure, np.inf, np.where(possible, -1.0, -np.inf))
    if (sure == possible).all():
        return Interval(lower, lower)
    return Interval(lower, np.where(sure, np.inf, np.where(possible, 1.0, -np.inf)))


_TESTS = {">=": np.greater_equal, ">": np.greater, "<=": np.less_equal, "<": np.less}
