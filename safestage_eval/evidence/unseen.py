"""Where a signal is unknown because what it is measured from was not recorded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body

from .facts import Request
from .missing_values import POSE, around
from .motion import before, derived
from .series import Series, hide

Bool = NDArray[np.bool_]


def mask_unseen(measured: Series, request: Request) -> Series:
    """The series, unknown where ``Episode.unseen`` is, and where it looks back to such a frame."""
    unseen, signal = request.episode.unseen, request.signal
    if unseen is None:
        return measured
    lost, over = beside(request, unseen), request.over
    hidden = lost | _looks_back(request, unseen)
    if over is not None and not signal.sums:
        hidden |= _within(request, lost, over)
    measured = hide(measured, hidden)
    lower, upper = measured.lower, measured.upper
    after = np.logical_or.accumulate(unseen)
    if signal.sums == "up":
        upper = np.where(after, np.inf, upper)
    if signal.sums == "down":
        lower = np.where(after, -np.inf, lower)
    return replace(measured, lower=lower, upper=upper)


def beside(request: Request, lost: Bool) -> Bool:
    """(T,) the lost frames; and their neighbours, where velocities are derived from poses."""
    reads = request.signal.reads_of(dict(request.options))
    if not request.signal.ahead or reads in ("com", "origin", "orientation"):
        return lost
    for body in {body for group in request.groups for body in group}:
        columns = {"angular_velocity" if reads == "angular velocity" else "linear_velocity"}
        if any(request.episode.bodies[body].com):
            columns.add("angular_velocity")
        if any(derived(request.episode, body, column) for column in columns):
            return around(lost)
    return lost


def _looks_back(request: Request, unseen: Bool) -> Bool:
    """(T,) where a change is measured from a moment that was not seen; the baseline may be one."""
    since = None if request.since is None else request.since.since
    if since is None:
        return np.full(len(unseen), unseen[0] and request.signal.from_start)
    if not request.signal.since:
        return np.zeros(len(unseen), np.bool_)
    return np.asarray(np.where(since < 0, unseen[0], unseen[since]), np.bool_)


def _within(request: Request, unseen: Bool, over: float) -> Bool:
    """(T,) less than ``over`` seconds after a frame that was not seen."""
    bounds = request.episode.clock.bounds
    ends = np.maximum.accumulate(np.where(unseen, bounds[1:], -np.inf))
    return np.asarray(request.episode.t < ends + over)


def gap_of(request: Request) -> Bool | None:
    """(T,) where something that a signal is measured from was not measured; None if nowhere."""
    signal, gaps, episode = request.signal, request.facts.gaps, request.episode
    if not signal.reads:
        return gaps.unseen
    if signal.reads == "robot":
        return gaps.of_bodies(
            b.name for b in episode.header.bodies if b.kind in ("robot", "gripper")
        )
    lost = gaps.unseen
    for body in {body for group in request.groups for body in group}:
        of_body = _gap_of_body(request, episode.bodies[body])
        if of_body is not None:
            lost = of_body if lost is None else lost | of_body
    if lost is None:
        return None
    if request.over is not None:
        lost = lost_within(request, lost)
    if signal.from_start or (signal.since and request.since is not None):
        lost = _of_reference(request, lost)
    return lost


def lost_within(request: Request, lost: Bool) -> Bool:
    """(T,) where a frame of the time that the signal looks back over is lost (T,)."""
    t, over = request.episode.t, request.over or 0.0
    if _reads_poses(request):
        first = before(t, over)
    else:
        first = np.maximum(np.searchsorted(t, t - over, "right") - 1, 0)
    many = np.concatenate([[0], np.cumsum(lost)])
    return np.asarray(many[1:] > many[first])


def _of_reference(request: Request, lost: Bool) -> Bool:
    """(T,) ``lost``, and the frames of which the reference was not measured."""
    reference = request.reference
    first = lost[reference.baseline.stretch]
    whole = bool(2 * first.sum() > len(first))  # most of it is missing
    if reference.since is None:
        return lost | whole
    since = reference.since
    return lost | np.where(since < 0, whole, lost[np.maximum(since, 0)])


def _reads_poses(request: Request) -> bool:
    reads = request.signal.reads_of(dict(request.options))
    return reads in ("com", "origin", "orientation")


def _gap_of_body(request: Request, body: Body) -> Bool | None:
    """(T,) where what the signal reads of one body was not measured; None if nowhere."""
    gaps, reads = request.facts.gaps, request.signal.reads_of(dict(request.options))
    offset = any(body.com)
    if reads == "up axis" and body.up_axis is None and request.since is None:
        return None
    if reads in ("orientation", "up axis"):
        return gaps.of_body(body.name, ("orientation",))
    if reads == "origin":
        return gaps.of_body(body.name, ("position",))
    if reads == "com":
        return gaps.of_body(body.name, POSE if offset else ("position",))
    if reads == "shape":
        return gaps.of_body(body.name, POSE) if body.geoms else None
    # derived from poses where no velocity was recorded, else taken as it is
    angular = reads == "angular velocity"
    column = "angular_velocity" if angular else "linear_velocity"
    recorded = gaps.of_body(body.name, (column,))
    if not derived(request.episode, body.name, column):
        more = ("orientation", "angular_velocity") if offset and not angular else ()
        other = gaps.of_body(body.name, more)
        return other if recorded is None else recorded if other is None else recorded | other
    columns: tuple[str, ...] = ("orientation",) if angular else ("position",)
    if offset and not angular:
        columns = ("position", "orientation", "angular_velocity")
    lost = gaps.of_body(body.name, columns)
    return None if lost is None else around(lost)
