"""Effect of a touch on a body at rest: how far it moves, and how far it tips."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode.runs import runs
from safestage_eval.evidence.intervals import Interval
from safestage_eval.evidence.motion import com_position
from safestage_eval.geometry.pose import rotate

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request

    from .relations import Relations
    from .worlds import World

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

STIRS = 1e-3
"""m. What has gone less than this is still at rest …"""
STIRS_TURN = 0.0175
"""rad. … and what has tipped less than this."""
PROMPT = 0.1
"""s. A body was at rest if it was for so long before the touch; the touch moved it if it stirred so
soon after it. At low rates, one frame on either side."""


class Way(NamedTuple):
    """Where a body was: centre of mass (T, 3) m, and its up axis (T, 3) if it has one."""

    place: F64
    up: F64 | None

    def gone(self, start: int, first: int, stop: int) -> tuple[F64, F64]:
        """(N,) m and rad that it is away from where it was at ``start``, in [first, stop)."""
        moved = np.linalg.norm(self.place[first:stop] - self.place[start], axis=1)
        if self.up is None:
            return moved, np.zeros(len(moved))
        up, then = self.up[first:stop], self.up[start]
        turned = np.arctan2(np.linalg.norm(np.cross(up, then), axis=1), up @ then)
        return moved, turned

    def stirs(self, start: int, first: int, stop: int) -> bool:
        """In [first, stop) it was away from where it was at ``start``, or had tipped."""
        moved, turned = self.gone(start, first, stop)
        return bool((moved >= STIRS).any() or (turned >= STIRS_TURN).any())


def effect_of_touch(request: Request) -> Interval:
    """(T,) how far the touches of two bodies or unions moved or, for an angle, tipped either.

    m or rad. A touch is a force at the frame or since the one before. It begins where the body was at
    the frame before it. Without forces a touch is a distance of at most 1 mm, and may be none; where
    a force is unknown, it may be one.
    """
    relations, angle = request.relations, request.signal.dimension == "angle"
    signals, seconds = relations.signals, request.number("over")
    episode, first, second = relations.episode, *map(signals.bodies, request.bodies)
    lower, upper = np.zeros(len(episode)), np.zeros(len(episode))
    for these, others in ((second, first), (first, second)):
        for body in these:
            it = episode.bodies[body]
            if not it.movable or it.kind in ("robot", "gripper", "region"):
                continue
            sure, may = _touching(relations, body, others)
            if not may.any():
                continue
            low, high = _done(relations, body, sure, may, seconds, angle)
            np.maximum(lower, low, out=lower)
            np.maximum(upper, high, out=upper)
    if not upper.any():
        return request.exact(upper)
    if relations.blind:
        lower = np.zeros(len(episode))
    same = lower if np.array_equal(lower, upper) else upper
    return Interval(lower, same, request.signal.dimension)


def _touching(relations: Relations, body: str, others: Sequence[str]) -> tuple[Bool, Bool]:
    """(T,) the body certainly touches one of the others, or did since the frame before; and it may."""
    (it,), them = relations.ids(body), {*relations.ids(*others)} - {*relations.ids(body)}

    def touching(world: World) -> Bool:
        near = [world.near(it, other) for other in world.beside(it) if other in them]
        return np.asarray(np.logical_or.reduce([np.zeros(world.frames, np.bool_), *near]))

    found = relations.ends(touching)
    return found.lower > 0, found.upper > 0


def _done(
    relations: Relations, body: str, sure: Bool, may: Bool, over: float, angle: bool
) -> tuple[F64, F64]:
    """(T,) what each touch did, on the frames of the touch; unknown where the recording broke off.

    Of what ``may`` be a touch and is not ``sure`` to be one (T,), the first part does at least what it does if
    the rest is none, provided that it is sure. Otherwise nothing, and at most what there is to do: what is
    away from one place by d is away from another such place by 2 d.
    """
    episode = relations.episode
    t, track = episode.t, episode.track(body)
    axis = episode.bodies[body].up_axis
    up = None if axis is None else rotate(track.orientation, np.asarray(axis, np.float64))
    way = Way(com_position(episode, body), up)
    lower, upper = np.zeros(len(t)), np.zeros(len(t))
    broken_off = episode.header.termination in ("truncated", "error")
    if max(way.place.max(axis=0) - way.place.min(axis=0)) < STIRS and up is None:
        return lower, upper
    for begin, end in runs(may).tolist():
        open_ = np.flatnonzero(~sure[begin:end])
        start = max(begin - 1, 0)
        before = min(int(t.searchsorted(t[start] - PROMPT - 1e-9)), max(start - 1, 0))
        soon, last = (int(t.searchsorted(t[end - 1] + after + 1e-9)) for after in (PROMPT, over))
        cut = broken_off and last >= len(t)
        if len(open_):
            whole = float(way.gone(start, start, max(last, end))[int(angle)].max())
            upper[begin:end] = np.inf if cut else 2 * whole
            end = begin + int(open_[0])  # noqa: PLW2901 — the sure part
            if end == begin or way.stirs(start, before, start + 1):
                continue
            soon, last = (
                int(t.searchsorted(t[end - 1] + after + 1e-9)) for after in (PROMPT, over)
            )
            if way.stirs(start, start, min(max(soon, end + 1), len(t))):
                lower[begin:end] = way.gone(start, start, last)[int(angle)].max()
            continue
        if way.stirs(start, before, start + 1):
            continue  # on its way already
        soon = max(soon, end + 1)
        if not way.stirs(start, start, min(soon, len(t))):
            if cut and soon >= len(t):
                upper[begin:end] = np.inf
            continue
        done = float(way.gone(start, start, last)[int(angle)].max())
        lower[begin:end], upper[begin:end] = done, np.inf if cut else done
    return lower, upper
