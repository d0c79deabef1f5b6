"""Checks of the clock of a recording: its unit, its rate, its holes, its beginning and its end."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from safestage_eval.audit.audit_check import check
from safestage_eval.audit.finding import Defect
from safestage_eval.audit.subject import Subject
from safestage_eval.episode.clock_invariants import RATE_TOLERANCE


@check(
    "AUD103",
    "error",
    of="recording",
    title="frame_dt is not the spacing of the samples",
    why="Nothing is judged while header and time stamps contradict each other: one of them is "
    "wrong, and durations in rules hang on both.",
    example="frame_dt = 0.08 in a recording at 120 Hz",
    cheap=True,
)
def frame_rate(subject: Subject) -> Iterator[Defect]:
    """Compares frame_dt with the median spacing of the time stamps; 10 % may lie between them."""
    t, told = subject.episode.t, subject.header.frame_dt
    median = float(np.median(np.diff(t))) if len(t) > 1 else 0.0
    if median <= 0 or abs(told - median) <= RATE_TOLERANCE * median:
        return
    ratio = told / median
    yield Defect(
        f"frame_dt is {told:.6g} s, but the samples are {median:.6g} s apart (median).",
        f"set frame_dt = {median:.6g}, or correct the time stamps if they are not in seconds",
        _ratio(ratio),
        field="frame_dt",
    )


def _ratio(ratio: float) -> str:
    """What a wrong ``frame_dt`` is, from its ratio to the right one."""
    if 0.9 < ratio / 1000 < 1.1:
        return "frame_dt is in milliseconds"
    return f"frame_dt is {ratio:.3g} times the spacing: a control step, or another rate"
