"""How far a body has fallen, as far as the frames tell: a fall may begin and end between two."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.declare import signal
from safestage_eval.evidence.intervals import Interval

if TYPE_CHECKING:
    from safestage_eval.evidence.facts import Request
    from safestage_eval.relations.relations import Relations

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

HAND_SPEED = 2.0
"""m/s. No hand gets to a body and away from it faster; the limit of the Franka arm is 1.7 m/s."""
LEAST = 1e-4
"""m. What has lost less height than this trembles, and falls not at all."""
WORTH = 2e-3
"""m. Whether a hand was near is looked at only where more height than this depends on it."""


class Grounds:
    """Reasons that a body is not falling, three-valued: (T,) each.

    Attributes:
        sure: it is supported, held or carried.
        perhaps: it may be.
        taken, hand: the robot has it; or may have it.
        notes: why the frames do not tell, where they do not.
    """

    def __init__(self, relations: Relations, name: str) -> None:
        told = {r: relations.told(r, [name]) for r in ("supported", "held", "carried")}
        sure = {r: found.lower > 0 for r, found in told.items()}
        may = {r: found.upper > 0 for r, found in told.items()}
        self.sure, self.perhaps = (np.logical_or.reduce([*x.values()]) for x in (sure, may))
        self.taken = sure["held"] | sure["carried"]
        self.hand = may["held"] | may["carried"]
        self.notes = tuple(
            dict.fromkeys(n for r in told if (sure[r] != may[r]).any() for n in told[r].notes)
        )


@signal("fall", "length", args=("a",), needs=("poses", "touch"), reads="", support=True)
def fall(request: Request) -> Interval:
    """Height that the body lost since it last was supported or in the robot's hand; a range where
    the frames do not tell how much of that it fell.

    m. The frame in which a fall ends counts what was lost since the frame before. The lower end is
    what it certainly fell: from the first frame at which nothing kept it, or from the frame before
    if it rested there and no hand can have been near in between. The upper end is all that both
    its lowest point and its COM lost since the last frame at which something certainly kept it, or a later one at which
    something may have. What the hand has at two frames in a row, it has between them too.
    """
    relations: Relations = request.relations
    name = request.bodies[0]
    ground = Grounds(relations, name)
    episode, movers = relations.episode, relations.signals.movers
    frames = np.arange(len(episode))
    high = relations.signals.com_position(name)[:, 2]
    low = high
    if movers.of([name]):
        low = np.asarray(np.broadcast_to(movers.lowest(name), len(high)), np.float64)

    def lost(since: NDArray[np.int64], now: NDArray[np.int64]) -> F64:
        """Height lost by both the COM and the lowest point: a body that tips over does not fall."""
        return np.minimum(high[since] - high[now], low[since] - low[now])

    before = _latest(ground.perhaps)  # −1: nothing kept it so far
    begin = before + 1
    certain = lost(np.minimum(begin, frames), frames)
    unaided = _unaided(relations, name, ground, before, begin, lost)
    certain = np.where(unaided, lost(np.maximum(before, 0), frames), certain)
    since = np.maximum(_latest(ground.sure), 0)
    most = np.minimum(*(_highest(z, since, ground.perhaps) - z for z in (low, high)))
    last = np.maximum(frames - 1, 0)
    most[ground.taken & ground.taken[last] & (since == last)] = 0.0
    certain, most = (np.where(some < LEAST, 0.0, some) for some in (certain, most))
    return Interval(np.minimum(certain, most), np.maximum(certain, most), "length", ground.notes)


def _latest(truth: Bool) -> NDArray[np.int64]:
    """(T,) the last frame before each at which something was true; −1 if there is none."""
    latest = np.full(len(truth), -1, np.int64)
    latest[1:] = np.where(truth, np.arange(len(truth)), -1)[:-1]
    return np.maximum.accumulate(latest)


def _highest(low: F64, since: NDArray[np.int64], perhaps: Bool) -> F64:
    """(T,) m, the greatest of heights ``low`` (T,) before each frame, at ``since`` or at a frame after it of ``perhaps``."""
    highest = low[since]
    for now in np.flatnonzero(perhaps[:-1] & (since[1:] != np.arange(len(low) - 1))) + 1:
        alike = np.searchsorted(
            since, since[now], "right"
        )  # of the frames that look back to the same one
        np.maximum(highest[now:alike], low[now - 1], out=highest[now:alike])
    return highest


def _unaided(
    relations: Relations,
    name: str,
    ground: Grounds,
    before: NDArray[np.int64],
    begin: NDArray[np.int64],
    lost: Callable[[NDArray[np.int64], NDArray[np.int64]], F64],
) -> Bool:
    """(T,) the body rested at ``before`` and fell from there: no hand lowered it, no slope led down."""
    frames = np.arange(len(begin))
    step = np.minimum(begin, len(begin) - 1)
    from_ = np.maximum(before, 0)
    worth = (before >= 0) & (lost(from_, step) >= WORTH)
    worth &= ground.sure[from_] & ~ground.hand[from_] & ~(ground.hand & (begin == frames))
    out = np.zeros(len(begin), np.bool_)
    alone: dict[int, bool] = {}
    for now in np.flatnonzero(worth):
        first, then = int(from_[now]), int(step[now])
        if first not in alone:
            alone[first] = not _hand_near(relations, name, first, then)
        slid = then == now and _same_support(relations, name, first, then)
        out[now] = alone[first] and not slid
    return out


def _hand_near(relations: Relations, name: str, first: int, then: int) -> bool:
    """Between two frames the hand may have come to the body and gone again."""
    from safestage_eval.geometry.group_clearance import clearance_series

    signals = relations.signals
    episode, movers = signals.episode, signals.movers
    hand = signals.bodies("gripper") or signals.bodies("robot")
    untold = any("links" in body.untold for body in episode.header.bodies)
    if not hand or untold or movers.unseen([*hand, name]):
        return True
    reach = HAND_SPEED * float(episode.t[then] - episode.t[first])
    both = np.array([first, then])
    apart = clearance_series([m.at(both) for m in movers.of(hand)], [movers[name].at(both)], reach)
    return bool(apart.lower.sum() < reach)


def _same_support(relations: Relations, name: str, first: int, then: int) -> bool:
    """One body bears it at both frames: it may have slid down on that."""
    bearers = relations.graph.bearers(relations.episode.body_index[name]).values()
    return any(bool(bears[first] and bears[then]) for bears in bearers)
