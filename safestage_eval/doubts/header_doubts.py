"""Checks of what the header says: time steps, gravity, the end, names."""

from __future__ import annotations

from collections.abc import Iterator

from safestage_eval.episode.contradiction import ContradictionError, doubt

from .check_registry import check
from .columns import Columns

GRAVITY = (1.0, 30.0)
"""m/s²; the Moon has 1.6, Jupiter 24.8."""


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
        )
    if header.control_dt is not None and header.control_dt < 0.99 * header.physics_dt:
        yield doubt(
            f"control_dt is {header.control_dt:.6g} s, less than physics_dt, "
            f"{header.physics_dt:.6g} s.",
            "control_dt >= physics_dt, in seconds",
            fix,
        )


@check(
    "AUD108",
    "error",
    title="header fields about the end contradict each other",
    why="Success decides when the final state is judged, and in which rate the episode counts.",
    example="success = false together with success_time = 9.6",
    over="columns",
)
def ending(columns: Columns) -> Iterator[ContradictionError]:
    """Compares success, success_time, termination, horizon and post_success_hold."""
    header = columns.header
    if header.termination == "success" and header.success is False:
        yield doubt(
            "termination is success, and yet success is false.",
            "success = true, or another termination",
            "correct the header: verdicts on what was left behind hang on it",
        )
    for name in ("horizon", "post_success_hold", "success_time"):
        value = getattr(header, name)
        if value is not None and value < 0:
            yield doubt(f"{name} is {value:.6g} s.", "seconds, not negative")


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
