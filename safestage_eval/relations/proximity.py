"""Touch and support inferred from geometry: for traces without contact forces."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.evidence.facts import Movers
from safestage_eval.geometry.group_clearance import Clearance, clearance_series
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.pose import relative

Bool = NDArray[np.bool_]
F64 = NDArray[np.float64]

TOUCH = 1e-3
"""m. Bodies that are no further apart than this touch."""
LIFT = 5e-3
"""m. The lift test raises a body by this …"""
OPENED = 2.5e-3
"""m. … and what bears it is then further away by more than this. A wall beside it is not."""
DRAWN = 1e-2
"""m. A finger is drawn off what it holds by this."""

SLACK = 5e-4
"""m. Distances of bodies that have hardly moved are bounded by this first, and measured only
where the bounds do not decide."""


class Proximity:
    """Touches and bearing by shapes along their poses; bodies are indices into ``header.bodies``."""

    def __init__(self, episode: Episode, movers: Movers) -> None:
        """Nothing is measured before it is asked for."""
        self._frames = len(episode)
        self._names = [body.name for body in episode.header.bodies]
        self._shaped = [i for i, body in enumerate(episode.header.bodies) if body.geoms]
        self._movers = movers
        self._touch: dict[tuple[int, int], Bool | None] = {}
        self._bears: dict[tuple[int, int], Bool] = {}

    def beside(self, body: int) -> list[int]:
        """The bodies that ever touch it, ascending."""
        return [i for i in self._shaped if i != body and self._ever(body, i) is not None]

    def touching(self, i: int, j: int) -> Bool:
        """(T,) true where the two are no more than ``TOUCH`` apart."""
        touch = self._ever(i, j)
        return np.zeros(self._frames, np.bool_) if touch is None else touch

    def bears(self, bearer: int, borne: int) -> Bool:
        """(T,) true where they touch, and raising the second by ``LIFT`` opens the gap."""
        if (bearer, borne) not in self._bears:
            bears = np.zeros(self._frames, np.bool_)
            rows = np.flatnonzero(self.touching(bearer, borne))
            if len(rows):
                bears[rows] = self._opens(bearer, borne, rows)
            self._bears[bearer, borne] = bears
        return self._bears[bearer, borne]

    def gap(self, i: int, j: int, rows: NDArray[np.intp]) -> Clearance:
        """(N,) m, bounds of how far apart two bodies are that touch; negative where they overlap."""
        return _apart(self._mover(i).at(rows), self._mover(j).at(rows), 0.0, deep=True)

    def lifted(self, body: int, by: Iterable[int], held: Bool) -> Bool:
        """(T,) true where one of the others bears it, looked at only where it is not ``held``."""
        lifted = np.zeros(self._frames, np.bool_)
        for other in by:
            rows = np.flatnonzero(self.touching(other, body) & ~held & ~lifted)
            if len(rows):
                lifted[rows] = self._opens(other, body, rows)
        return lifted

    def _ever(self, i: int, j: int) -> Bool | None:
        key = (min(i, j), max(i, j))
        if key not in self._touch:
            touch = None
            if key[0] in self._shaped and key[1] in self._shaped:
                a, b = self._mover(key[0]), self._mover(key[1])
                near = _apart(a, b, SLACK)
                sure, open_ = near.upper <= TOUCH, (near.lower <= TOUCH) & (near.upper > TOUCH)
                rows = np.flatnonzero(open_)
                if len(rows):
                    sure[rows] = _apart(a.at(rows), b.at(rows), 0.0).upper <= TOUCH
                if sure.any():
                    touch = np.broadcast_to(sure, self._frames)
            self._touch[key] = touch
        return self._touch[key]

    def between(self, body: int, left: int, right: int, rows: NDArray[np.intp]) -> Bool:
        """(N,) two fingers that touch the body have it between them."""
        way = self._mover(left).at(rows).centre - self._mover(right).at(rows).centre
        long = np.linalg.norm(way, axis=1, keepdims=True)
        way /= np.where(long > 0, long, 1.0)
        between = np.ones(len(rows), np.bool_)
        for finger, outward in ((left, way), (right, -way)):
            some = np.flatnonzero(between)
            between[some] = self._presses(finger, body, rows[some], outward[some])
        return between

    def _presses(self, finger: int, body: int, rows: NDArray[np.intp], outward: F64) -> Bool:
        """(N,) drawn outward the finger leaves the body, or pushed inward it goes into it.

        By more than half of the way, so that it touches a face that is turned to it.
        """
        over, under = self._mover(finger).at(rows), self._mover(body).at(rows)
        drawn = Mover(over.shape, over.position + DRAWN * outward, over.orientation)
        presses = np.asarray(_apart(drawn, under, SLACK, 2 * DRAWN).lower > DRAWN / 2).copy()
        rest = np.flatnonzero(~presses)
        if len(rest):
            at = over.at(rest)
            pushed = Mover(over.shape, at.position - LIFT * outward[rest], at.orientation)
            into = _apart(pushed, under.at(rest), SLACK, 2 * TOUCH, deep=True)
            presses[rest] = into.upper < -LIFT / 2
        return presses

    def _opens(self, bearer: int, borne: int, rows: NDArray[np.intp]) -> Bool:
        """(N,) the lift test at some frames, by bounds where these decide."""
        over, under = self._mover(borne).at(rows), self._mover(bearer).at(rows)
        low, high = _opening(over, under, SLACK)
        sure, open_ = low > OPENED, (low <= OPENED) & (high > OPENED)
        if open_.any():
            some = np.flatnonzero(np.broadcast_to(open_, len(rows)))
            sure = np.broadcast_to(sure, len(rows)).copy()
            sure[some] = _opening(over.at(some), under.at(some), 0.0)[0] > OPENED
        return sure

    def _mover(self, body: int) -> Mover:
        return self._movers[self._names[body]]


def _apart(
    a: Mover, b: Mover, slack: float, cap: float = 2 * TOUCH, *, deep: bool = False
) -> Clearance:
    """Distance of two bodies, seen from the second: what goes along with it has hardly moved."""
    if len(a) > 1 and len(b) > 1:
        place = relative(b.position, b.orientation, a.position, a.orientation)
        a, b = Mover.build(a.shape, *place), Mover.build(b.shape, (0, 0, 0), (1, 0, 0, 0))
    return clearance_series([a], [b], cap, slack=slack, deep=deep)


def _opening(over: Mover, under: Mover, slack: float) -> tuple[NDArray[np.float64], ...]:
    """(N,) m, least and greatest growth of the gap when the first body is raised by ``LIFT``."""
    raised = Mover(over.shape, over.position + np.array([0.0, 0.0, LIFT]), over.orientation)
    now = _apart(over, under, slack)
    then = _apart(raised, under, slack, 2 * LIFT)
    return then.lower - now.upper, then.upper - now.lower
