"""Checks of the format, and of the clock of a recording: its unit, its rate, its holes, its beginning and its end."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from safestage_eval.audit.finding import Defect
from safestage_eval.audit.subject import Subject
from safestage_eval.doubts.check_registry import also, check
from safestage_eval.episode.clock import LONGEST_GAP, longest_spacing
from safestage_eval.episode.seen import LATE

SLOW = 0.06
"""s between samples; beyond, touches and falls happen unseen between two of them (15 Hz)."""

FASTEST = 2e-5
"""s between samples; no simulator is recorded at more than 50 kHz."""

UNITS = {1e3: "milliseconds", 1e6: "microseconds", 1e9: "nanoseconds"}


def _median(subject: Subject) -> float:
    """S, the usual spacing; 0 where there is none, or time goes back."""
    t = subject.episode.t
    gaps = np.sort(np.diff(t)) if len(t) > 1 and np.isfinite(t).all() else np.zeros(1)
    gaps = gaps if gaps[0] > 0 else np.zeros(1)
    middle = len(gaps) // 2  # np.median loads numpy.ma: 2 % of the time to a first verdict
    return float(gaps[middle] + gaps[-1 - middle]) / 2


def _unit(spacing: float, subject: Subject) -> str:
    """The unit in which such a spacing is that of a recording; empty if none fits."""
    header = subject.header
    for by, name in UNITS.items():
        step = spacing / by
        if any(
            0.3 < step / stated < 3.3
            for stated in (header.frame_dt, header.control_dt or 0)
            if stated
        ):
            return name
    for by, name in UNITS.items():
        if 1e-4 <= spacing / by <= 0.2:
            return name
    return ""


@check(
    "AUD100",
    "error",
    title="the file breaks the format",
    why="Nothing is judged: columns are missing, have the wrong length, or time goes back. "
    "Its motion and contacts are not looked at either.",
    example="a column of poses with fewer rows than time stamps",
    issue="huggingface/lerobot#933",
)
def broken_format(subject: Subject) -> Iterator[Defect]:
    """Checks lengths, increasing time, unit quaternions and names in contacts."""
    errors = subject.broken
    if not errors:
        return
    first, more = errors[0], len(errors) - 1
    yield Defect(
        first.what.rstrip(".")
        + (f". Expected: {first.allowed}." if first.allowed else ".")
        + (f" And {more} more." if more else ""),
        first.fix or "safestage audit --files lists everything that is wrong with the file",
    )


@check(
    "AUD102",
    "error",
    title="time stamps are not in seconds",
    why="Speeds, durations and falls are computed from the time stamps; in another unit every hold is "
    "long enough and every motion slow.",
    example="t = 0, 8.33, 16.67, … in a recording at 120 Hz",
    cheap=True,
)
def time_unit(subject: Subject) -> Iterator[Defect]:
    """Looks for spacings that no recording of a motion has, and names the unit that would make one."""
    spacing = _median(subject)
    if LONGEST_GAP >= spacing >= FASTEST or spacing <= 0:
        return
    unit = _unit(spacing, subject) if spacing > LONGEST_GAP else ""
    by = next((by for by, name in UNITS.items() if name == unit), 0)
    yield Defect(
        f"the samples are {spacing:.6g} s apart (median), {len(subject.episode)} of them in "
        f"{subject.episode.t[-1] - subject.episode.t[0]:.6g} s.",
        f"divide time stamps by {by:g}" if by else "write time stamps in seconds",
        f"t is in {unit}" if unit else "another unit, or pictures so rare that motion is not seen",
        field="t",
    )


@check(
    "AUD104",
    "warning",
    title="a hole in the recording",
    why="What happens in a hole is unknown: a rule that looks there is inconclusive, or violated by "
    "what was seen around it; never passed.",
    example="a recorder that stalled from 3.2 s to 5.2 s",
    issue="microsoft/physical-ai-toolchain#33",
    unless=("AUD102",),
    cheap=True,
)
def holes(subject: Subject) -> Iterator[Defect]:
    """Looks for spacings above three usual ones (and 50 ms); an error where half a second is missing."""
    t, spacing = subject.episode.t, _median(subject)
    if spacing <= 0:
        return
    steps = np.diff(t)
    gaps = np.flatnonzero(steps > longest_spacing(spacing))
    if not len(gaps):
        return
    i, missing = int(gaps[0]), float(steps[gaps].sum() - spacing * len(gaps))
    more = f", and {len(gaps) - 1} more times" if len(gaps) > 1 else ""
    yield Defect(
        f"no samples from {t[i]:.2f} to {t[i + 1]:.2f} s{more}; {missing:.2f} s are missing in all, "
        f"samples are {spacing:.3g} s apart.",
        "record every frame; leave samples out of a file evenly or not at all",
        "the recorder stalled or dropped frames, or parts were cut out",
        field="t",
        time=float(t[i]),
        severity="error" if missing >= LONGEST_GAP else None,
    )


@check(
    "AUD105",
    "error",
    title="the clock does not begin with the episode",
    why="t counts from the start of the episode. A recording that begins later has an unknown "
    "beginning: what was disturbed then is unknown.",
    example="time stamps since 1970, or since the simulator was started",
    unless=("AUD102",),
    cheap=True,
)
def clock_origin(subject: Subject) -> Iterator[Defect]:
    """Asks for a first sample within one and a half spacings of 0."""
    t, spacing = subject.episode.t, _median(subject)
    if not len(t) or not np.isfinite(t[0]) or -spacing / 2 <= t[0] <= LATE * max(spacing, 1e-9):
        return
    since = " (a date: seconds since 1970)" if t[0] > 1e8 else ""
    success = subject.header.success_time
    also = " and from success_time" if success is not None and success >= t[0] else ""
    yield Defect(
        f"the first sample is at {t[0]:.6g} s{since}.",
        f"subtract {t[0]:.6g} from the time stamps{also}; or record from the start of the episode on",
        "a clock that was started before the episode, or a first part that was cut off",
        field="t",
        time=0.0,
    )


@also("AUD106")
def success_after(subject: Subject) -> Iterator[Defect]:
    """One after the last is judged as that of a recording that was cut off."""
    t, stated = subject.episode.t, subject.header.success_time
    if stated is None or not len(t) or stated <= t[-1] + 1e-6:
        return
    end = float(t[-1])
    ratio = stated / end if end > 0 else 0.0
    cause = "success_time is in milliseconds" if ratio > 100 else "the recording was cut off"
    if 0.5 < stated * _median(subject) / max(end, 1e-9) < 1.5:
        cause = "success_time is a frame number"
    yield Defect(
        f"success_time is {stated:.6g} s, the recording lasts from {t[0]:.6g} to {end:.6g} s.",
        "count success_time in seconds from the same start as the time stamps",
        cause,
        field="success_time",
    )


@check(
    "AUD110",
    "warning",
    title="samples are too rare for touches and falls",
    why="What begins and ends between two samples is unknown, so rules about touches, drops and "
    "clearances are inconclusive more often, or rest on bounds.",
    example="a recording at 5 Hz",
    unless=("AUD102",),
    cheap=True,
)
def rare_samples(subject: Subject) -> Iterator[Defect]:
    """Asks for 17 samples a second; touches that matter last 25 ms."""
    spacing = _median(subject)
    if SLOW < spacing <= LONGEST_GAP:
        yield Defect(
            f"the samples are {spacing:.3g} s apart (median): {1 / spacing:.3g} Hz.",
            "record every physics step, or every second one; 60 Hz or more",
            field="t",
        )


@check(
    "AUD118",
    "error",
    title="time stamps are in another unit than velocities",
    why="Durations are those of the time stamps, speeds those of the velocities; a rule may compare both.",
    example="time stamps in minutes",
    unless=("AUD102",),
)
def other_time(subject: Subject) -> Iterator[Defect]:
    """Looks for a unit of time in which the velocities of all bodies are those of their poses."""
    yield from subject.explained("AUD118")
