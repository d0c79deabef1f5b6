"""Invariants of time: the header must agree with the time stamps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from .contradiction import ContradictionError, doubt
from .header import Header

RATE_TOLERANCE = 0.10
"""Share of the median spacing by which ``frame_dt`` may differ from it."""


RATIOS = {
    1e3: "the time stamps are in milliseconds: divide them by 1000",
    1e6: "the time stamps are in microseconds: divide them by 1e6",
    1e9: "the time stamps are in nanoseconds: divide them by 1e9",
    1e-3: "frame_dt is in milliseconds: divide it by 1000",
    0.1: "frame_dt is ten times the spacing: write the time between two samples",
    10.0: "frame_dt is a tenth of the spacing: write the time between two samples",
}
"""Spacing over ``frame_dt`` → the likely mistake, and how to mend it."""


def _cause(ratio: float, product: float) -> str:
    if abs(product - 1) <= RATE_TOLERANCE:
        return "frame_dt is a rate in Hz: write the time between two samples"
    near = (says for by, says in RATIOS.items() if abs(ratio / by - 1) <= RATE_TOLERANCE)
    usual = "write the rate at which the episode was recorded, or the stamps at which it was"
    return next(near, usual)


def check_clock(header: Header, t: NDArray[np.float64], where: str) -> Iterator[ContradictionError]:
    """``frame_dt`` and the moment of success against the time stamps (T,) s.

    A success after the last sample is no contradiction: the recording was cut off before it.
    """
    if len(t) > 1:
        with np.errstate(invalid="ignore", over="ignore"):  # times may be anything
            steps = np.sort(t[1:] - t[:-1])  # np.median imports masked arrays
        median = float(steps[(len(steps) - 1) // 2] + steps[len(steps) // 2]) / 2
        if median > 0 and not abs(header.frame_dt - median) <= RATE_TOLERANCE * median:
            ratio = median / header.frame_dt if header.frame_dt > 0 else 0.0
            yield doubt(
                f"frame_dt is {header.frame_dt:.6g} s, but the samples are {median:.6g} s apart "
                "(median).",
                f"frame_dt within {RATE_TOLERANCE:.0%} of the spacing of the time stamps",
                _cause(ratio, header.frame_dt * median),
                where=where,
                code="AUD103",
            )
    time = header.success_time
    if time is None:
        return
    if header.success is False:
        yield doubt(
            f"success is false, and yet success_time is {time:.6g} s.",
            "success = true with a time, or no success_time",
            "correct the header: verdicts on what was left behind hang on it",
            where=where,
            code="AUD108",
        )
    if len(t) and time < t[0] - 1e-6:
        yield doubt(
            f"success_time is {time:.6g} s, before the first sample at {t[0]:.6g} s.",
            "a time stamp of the episode, or later where the recording was cut off",
            "count success_time from the same start as the time stamps",
            where=where,
            code="AUD106",
        )
