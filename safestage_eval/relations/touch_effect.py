"""Effect of a touch on a body at rest: how far it moves, and how far it tips."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval._process.compiled import kernel
from safestage_eval.episode.runs import runs
from safestage_eval.evidence.motion import com_position
from safestage_eval.evidence.series import Series
from safestage_eval.geometry.pose import rotate

if TYPE_CHECKING:
    from .relations import SupportRequest
    from .support_facts import Support

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
        up = np.zeros((0, 3)) if self.up is None else self.up
        return _stirs(self.place, up, start, first, stop)


def effect_of_touch(request: SupportRequest) -> Series:
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
    return Series(lower, same, request.signal.dimension)


def _touching(relations: Support, body: str, others: Sequence[str]) -> tuple[Bool, Bool]:
    """(T,) the body certainly touches one of the others, or did since the frame before; and it may."""
    index = relations.episode.body_index
    near = set(relations.touches.beside(index[body]))
    out, lost = (np.zeros(len(relations.episode), np.bool_) for _ in range(2))
    for other in others:
        if index[other] not in near or other == body:
            continue
        if relations.blind:
            out |= relations.proximity.touching(index[body], index[other])
        else:
            sums, pair = relations.signals.contact_sums, (index[body], index[other])
            out |= sums.peak(*pair) > 0
            if (unknown := sums.unknown(*pair)) is not None:
                lost |= unknown
    return out, out | lost if (lost & ~out).any() else out


def _done(
    relations: Support, body: str, sure: Bool, may: Bool, over: float, angle: bool
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


@kernel
def _stirs(place: F64, up: F64, start: int, first: int, stop: int) -> bool:
    """Whether a body, or its up axis (0, 3 if it has none), is away in [first, stop) from ``start``."""
    for frame in range(first, stop):
        moved, cross, dot = 0.0, 0.0, 0.0
        for i in range(3):
            moved += (place[frame, i] - place[start, i]) ** 2
        if moved >= STIRS**2:
            return True
        if not len(up):
            continue
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            cross += (up[frame, j] * up[start, k] - up[frame, k] * up[start, j]) ** 2
            dot += up[frame, i] * up[start, i]
        if np.arctan2(np.sqrt(cross), dot) >= STIRS_TURN:
            return True
    return False
