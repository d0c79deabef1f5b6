"""Where a signal is unknown because what it is measured from was not recorded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body

from .facts import Request
from .intervals import Interval, hidden
from .missing_values import POSE, around, either
from .motion import before, derived

Bool = NDArray[np.bool_]

PLACES = ("com", "origin", "orientation")
"""Values of ``Signal.reads`` that need no velocities."""


def known_part(measured: Interval, request: Request) -> Interval:
    """The series, unknown where something that it is measured from, then or before, was not recorded."""
    lost, unseen = gap_of(request), request.facts.gaps.unseen
    if (
        unseen is not None and request.signal.sums
    ):  # whatever happened meanwhile is missing for good
        after = np.logical_or.accumulate(unseen)
        if request.signal.sums == "up":
            measured = replace(measured, upper=np.where(after, np.inf, measured.upper))
        else:
            measured = replace(measured, lower=np.where(after, -np.inf, measured.lower))
    nan = np.isnan(measured.lower) | np.isnan(measured.upper)
    lost = either(lost, nan if nan.any() else None)
    if lost is None:
        return measured
    note = f"{request.name}({', '.join(request.bodies)}) was not measured at every frame"
    return hidden(measured, lost, note)


def gap_of(request: Request) -> Bool | None:
    """(T,) where something that a signal is measured from was not measured; None if nowhere."""
    signal, gaps, episode = request.signal, request.facts.gaps, request.episode
    if signal.reads == "robot":
        robot = (b.name for b in episode.header.bodies if b.kind in ("robot", "gripper"))
        return gaps.of_bodies(robot)
    bodies = {body for group in request.groups for body in group} if signal.reads else ()
    lost = either(gaps.unseen, *(_gap_of_body(request, episode.bodies[body]) for body in bodies))
    if lost is None:
        return None
    if signal.joints and signal.ahead:  # derived from the positions beside
        lost = around(lost)
    if request.over is not None and not signal.sums:
        lost = lost_within(request, lost)
    if signal.from_start or (signal.since and request.since is not None):
        lost = _of_reference(request, lost)
    return lost


def lost_within(request: Request, lost: Bool) -> Bool:
    """(T,) where a frame of the time that the signal looks back over is lost (T,)."""
    t, over = request.episode.t, request.over or 0.0
    if request.signal.reads_of(dict(request.options)) in PLACES:
        first = before(t, over)
    else:
        first = np.maximum(np.searchsorted(t, t - over, "right") - 1, 0)
    many = np.concatenate([[0], np.cumsum(lost)])
    return np.asarray(many[1:] > many[first])


def _of_reference(request: Request, lost: Bool) -> Bool:
    """(T,) ``lost``, and the frames of which the reference was not measured."""
    reference, unseen = request.reference, request.facts.gaps.unseen
    first = lost[reference.baseline.stretch]
    late = unseen is not None and bool(unseen[0])  # how it began was not seen
    whole = late or bool(2 * first.sum() > len(first))  # most of it is missing
    if reference.since is None:
        return lost | whole
    since = reference.since
    return lost | np.where(since < 0, whole, lost[np.maximum(since, 0)])


def _gap_of_body(request: Request, body: Body) -> Bool | None:
    """(T,) where what the signal reads of one body was not measured; None if nowhere."""
    gaps, reads = request.facts.gaps, request.signal.reads_of(dict(request.options))
    offset = any(body.com)
    if reads == "up axis" and body.up_axis is None and request.since is None:
        return None
    if reads == "shape" and not body.geoms:
        return None
    columns: dict[str, tuple[str, ...]] = {
        "orientation": ("orientation",), "up axis": ("orientation",), "origin": ("position",),
        "com": POSE if offset else ("position",), "shape": POSE,
    }  # fmt: skip
    if reads in columns:
        return gaps.of_body(body.name, columns[reads])
    turns, moves = reads == "angular velocity" or offset, reads != "angular velocity"
    lost = gaps.of_body(body.name, ("orientation",)) if moves and offset else None
    for column, pose, needed in (
        ("linear_velocity", "position", moves),
        ("angular_velocity", "orientation", turns),
    ):
        if needed:
            lost = either(lost, gaps.of_body(body.name, (column,)))
        if needed and derived(request.episode, body.name, column):
            beside = either(gaps.of_body(body.name, (pose,)), gaps.unseen)
            lost = either(lost, None if beside is None else around(beside))
    return lost
