"""Checks of what the header says: time steps, the end, gravity, names.

Where success is in doubt it is unknown; an episode with any other of these contradictions is not
scored: nothing of it would mean what it says.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from safestage_eval.episode import Episode
from safestage_eval.episode.contradiction import ContradictionError, doubt

from .check_registry import check
from .columns import Columns

RATE_TOLERANCE = 0.10
"""Share of the median spacing by which ``frame_dt`` may differ from it."""

RATIOS = {
    1e3: "the time stamps are in milliseconds",
    1e6: "the time stamps are in microseconds",
    1e9: "the time stamps are in nanoseconds",
    1e-3: "frame_dt is in milliseconds",
    0.1: "frame_dt is ten times the spacing",
    10.0: "frame_dt is a tenth of the spacing",
}
"""Spacing over ``frame_dt`` → the likely mistake."""

LEVEL = 1e-3
"""Allowed sine of the angle between gravity and −z: rounding, no slope."""

GRAVITY = (1.0, 30.0)
"""m/s²; the Moon has 1.6, Jupiter 24.8."""


@check(
    "AUD103",
    "error",
    title="frame_dt is not the spacing of the samples",
    why="Nothing is judged while header and time stamps contradict each other: one of them is "
    "wrong, and durations in rules hang on both.",
    example="frame_dt = 0.083 in a recording at 120 Hz",
    unless=("AUD102",),
    over="header",
)
def frame_rate(episode: Episode) -> Iterator[ContradictionError]:
    """Compares frame_dt with the median spacing of the time stamps; 10 % may lie between them."""
    stated, t = episode.header.frame_dt, episode.t
    if len(t) < 2:
        return
    steps = np.sort(t[1:] - t[:-1])  # np.median imports masked arrays
    median = float(steps[(len(steps) - 1) // 2] + steps[len(steps) // 2]) / 2
    if abs(stated - median) > RATE_TOLERANCE * median:
        near = (says for by, says in RATIOS.items() if _alike(median, by * stated))
        cause = "a control step, or another rate"
        if _alike(stated * median, 1):
            cause = "frame_dt is a rate in Hz"
        yield doubt(
            f"frame_dt is {stated:.6g} s, but the samples are {median:.6g} s apart (median).",
            f"frame_dt within {RATE_TOLERANCE:.0%} of the spacing of the time stamps",
            f"set frame_dt = {median:.6g}, or correct the time stamps if these are wrong "
            f"({next(near, cause)})",
            field="frame_dt",
        )


def _alike(one: float, other: float) -> bool:
    return abs(one - other) <= RATE_TOLERANCE * other


@check(
    "AUD106",
    "error",
    title="success_time lies outside the recording",
    why="Everything about the final state is judged from success on.",
    example="success_time = 9.62 in a recording that ends at 8.0 s",
    unless=("AUD102", "AUD105"),
    over="header",
)
def success_before(episode: Episode) -> Iterator[ContradictionError]:
    """Compares success_time with the first and the last time stamp."""
    time, t = episode.header.success_time, episode.t
    if time is not None and len(t) and time < t[0] - 1e-6:
        yield doubt(
            f"success_time is {time:.6g} s, before the first sample at {t[0]:.6g} s.",
            "a time stamp of the episode, or later where the recording was cut off",
            "count success_time from the same start as the time stamps",
            hides=("success",),
            field="success_time",
        )


@check(
    "AUD107",
    "error",
    title="time steps in the header cannot be",
    why="physics_dt, frame_dt and control_dt turn durations in rules into frames.",
    example="physics_dt = 8.33 (milliseconds) beside frame_dt = 0.00833",
    unless=("AUD102", "AUD103"),
    over="columns",
)
def steps(columns: Columns) -> Iterator[ContradictionError]:
    """Asks for positive steps, physics_dt ≤ frame_dt, and physics_dt ≤ control_dt."""
    header = columns.header
    fix = "look for milliseconds, or a rate in place of a step"
    if header.physics_dt > 1.01 * header.frame_dt:
        yield doubt(
            f"physics_dt is {header.physics_dt:.6g} s, more than frame_dt, {header.frame_dt:.6g} s: "
            "nothing can be recorded between two steps.",
            "physics_dt <= frame_dt, in seconds",
            fix,
            field="physics_dt",
        )
    if header.control_dt is not None and header.control_dt < 0.99 * header.physics_dt:
        yield doubt(
            f"control_dt is {header.control_dt:.6g} s, less than physics_dt, "
            f"{header.physics_dt:.6g} s.",
            "control_dt >= physics_dt, in seconds",
            fix,
            field="control_dt",
        )


@check(
    "AUD108",
    "error",
    title="header fields about the end contradict each other",
    why="Success decides when the final state is judged, and in which rate the episode counts.",
    example="success = false together with success_time = 9.6",
    over="header",
)
def ending(episode: Episode) -> Iterator[ContradictionError]:
    """Compares success, success_time, termination, horizon and post_success_hold."""
    header = episode.header
    if header.termination == "success" and header.success is False:
        yield doubt(
            "termination is success, and yet success is false.",
            "success = true, or another termination",
            "correct the header: verdicts on what was left behind hang on it",
            hides=("success",),
            field="success",
        )
    if header.success_time is not None and header.success is False:
        yield doubt(
            f"success is false, and yet success_time is {header.success_time:.6g} s.",
            "success = true with a time, or no success_time",
            "correct the header: verdicts on what was left behind hang on it",
            hides=("success",),
            field="success_time",
        )
    for name in ("horizon", "post_success_hold"):
        value = getattr(header, name)
        if value is not None and value < 0:
            yield doubt(f"{name} is {value:.6g} s.", "seconds, not negative", field=name)


@check(
    "AUD113",
    "error",
    title="z does not point up",
    why="Support, tilt, falls and edges are about up and down.",
    example="poses from an engine whose y axis points up",
    issue="newton-physics/newton#84",
    unless=("AUD101", "AUD111"),
    over="header",
)
def gravity_direction(episode: Episode) -> Iterator[ContradictionError]:
    """Asks for a gravity along −z."""
    x, y, z = episode.header.gravity
    if not (z < 0 and np.hypot(x, y) <= LEVEL * -z):
        yield doubt(
            f"gravity is {episode.header.gravity}",
            "m/s² along −z of the world",
            "record in a world whose z axis points up",
            field="gravity",
        )


@check(
    "AUD117",
    "error",
    title="bodies do not fall with the gravity of the header",
    why="Weights, and with them support and dependence, are computed from gravity; falls that do not fit "
    "it mean another unit of length or time, or another gravity in the simulation.",
    example="gravity = (0, 0, -9.81) in a scene that was simulated at half of that",
    unless=("AUD101", "AUD102", "AUD113", "AUD114", "AUD115"),
    over="columns",
)
def gravity(columns: Columns) -> Iterator[ContradictionError]:
    """Asks for a gravity of a place where robots are: 1 to 30 m/s²."""
    down = -columns.header.gravity[2]
    if not GRAVITY[0] <= down <= GRAVITY[1]:
        yield doubt(
            f"gravity is {down:.6g} m/s².",
            f"{GRAVITY[0]:g} to {GRAVITY[1]:g} m/s²",
            "look for cm/s² or mm/s²",
            field="gravity",
        )


@check(
    "AUD138",
    "error",
    title="a parent or a joint names a body that is not there",
    why="What is jointed to a body that is not recorded seems to float.",
    example="a robot without one of its links",
    over="columns",
)
def missing_parents(columns: Columns) -> Iterator[ContradictionError]:
    """Looks the names of parents and of moved bodies up among the bodies."""
    header = columns.header
    names = {body.name for body in header.bodies}
    told = [(f"the parent of {b.name!r}", b.parent) for b in header.bodies]
    told += [(f"the body that joint {j.name!r} moves", j.body) for j in header.joints]
    for what, name in told:
        if name is not None and name not in names:
            yield doubt(
                f"{what} is {name!r}, which is no body.",
                fix="record that body too: what is jointed to it cannot be judged without it",
            )
