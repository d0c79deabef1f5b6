"""All signals of one episode, each measured once, when it is first asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from safestage_eval.episode import Episode
from safestage_eval.geometry.gjk import PROMISED
from safestage_eval.geometry.group_clearance import SLACK, Clearance, motion_bound

from .declare import SIGNALS, Options, Signal
from .facts import Facts, Request
from .query import Growth, Kind, Query
from .reference import Reference
from .series import Series, hidden, unknown
from .store import Store
from .unseen import gap_of, mask_unseen

CAP = 0.10
"""m: a clearance series is exact up to here; beyond, it says only "more than that"."""


def how(name: str, reach: float, limits: Sequence[float]) -> tuple[float, bool, float]:
    """Cap, depth and slack with which a signal is measured for limits; see ``Signals.get``."""
    if not SIGNALS[name].capped:
        return 0.0, False, 0.0
    deep = min(limits, default=1.0) <= 0
    return max(reach, CAP), deep, SLACK if limits and not deep else 0.0


def _growth(signal: Signal) -> Growth:
    """How a signal changes when the episode grows."""
    if signal.per_frame:
        return Growth.PER_FRAME
    return Growth.OPEN_END if signal.ahead else Growth.WHOLE


def loose(found: Series, cap: float) -> Clearance:
    """The frames at which slack was taken: hardly ever any, and they do not change."""
    at = (found.upper - found.lower > PROMISED) & (found.lower < cap)
    return Clearance(found.lower[at], found.upper[at])


class Signals(Facts):
    """Signals of an episode by name and bodies, in SI, each a ``Series`` over all frames."""

    def __init__(
        self,
        episode: Episode,
        baseline_frames: int = 5,
        backend: str = "gjk",
        store: Store | None = None,
    ) -> None:
        """Arguments as ``Facts``."""
        super().__init__(episode, baseline_frames, backend, store)
        # by identity: the series is kept beside what was found
        self._slack: dict[int, tuple[Series, Clearance]] = {}

    def get(
        self,
        name: str,
        bodies: Sequence[str] = (),
        reference: Reference | None = None,
        reach: float = CAP,
        options: Options = (),
        limits: Sequence[float] = (),
    ) -> Series:
        """One signal.

        Args:
            name: of a declared signal.
            bodies: names of bodies or unions, in the signal's order.
            reference: for signals that measure a change; the baseline if None.
            reach: m, for clearances: distances up to here are wanted exactly.
            options: what the signal's definition adds, sorted by name.
            limits: m, for clearances: all that they are compared with. Bounds may then be 10 µm
                wider where they leave no limit open; depths are measured for limits up to 0.
                Without limits, bounds are as tight as they can be.

        Raises KeyError for a name or body that does not exist.
        """
        if not SIGNALS[name].capped:
            return self.measured(name, tuple(bodies), reference, 0.0, False, 0.0, options)
        cap, deep, slack = how(name, reach, limits)
        found = self.measured(name, tuple(bodies), reference, cap, deep, slack, options)
        if slack and any(self._loose(found, cap).leaves_open(x) for x in limits):
            found = self.measured(name, tuple(bodies), reference, cap, deep, 0.0, options)
        return found

    def _loose(self, found: Series, cap: float) -> Clearance:
        if id(found) not in self._slack:
            self._slack[id(found)] = found, loose(found, cap)
        return self._slack[id(found)][1]

    def between_frames(self, name: str, bodies: Sequence[str], frame: int) -> float | None:
        """How much further (m) the value may have gone between the frame and its neighbours.

        Half the bound on the relative motion over one recorded step: for distances only, None for
        other signals.
        """
        if not SIGNALS[name].capped:
            return None
        query = self.query("between frames", name, tuple(bodies), frame=frame)
        found: float = self.store.value(query, lambda _: self._between(bodies, frame))
        return found

    def _between(self, bodies: Sequence[str], frame: int) -> float:
        pairs = self.pairs_between(bodies)
        near = slice(max(frame - 1, 0), frame + 2)
        bounds = [motion_bound(a.at(near), b.at(near)).max(initial=0.0) for a, b in pairs]
        return float(max(bounds, default=0.0)) / 2

    def measured(
        self,
        name: str,
        bodies: tuple[str, ...],
        reference: Reference | None,
        cap: float,
        deep: bool,
        slack: float,
        options: Options,
    ) -> Series:
        """Measure once: ``cap``, ``deep`` and ``slack`` as in ``query.Query``."""

        def measure(near: Any) -> Series:
            signals: Signals = self if near is None else near.signals
            return signals._measure(name, bodies, reference, cap, deep, slack, options)

        since = reference.key if reference else ""
        query = self.query("signal", name, bodies, since, cap, deep, slack, options)
        return self.store.series(query, measure, _growth(SIGNALS[name]))

    def query(
        self,
        kind: Kind,
        name: str = "",
        bodies: tuple[str, ...] = (),
        since: str = "",
        cap: float = 0.0,
        deep: bool = False,
        slack: float = 0.0,
        options: Options = (),
        frame: int = -1,
    ) -> Query:
        """A query about the episode, as it is measured here; arguments as in ``Query``."""
        return Query(
            kind, name, bodies, since, cap, deep, slack, options, frame, self.backend,
            self.baseline.frames,
        )  # fmt: skip

    def _measure(
        self,
        name: str,
        bodies: tuple[str, ...],
        reference: Reference | None,
        cap: float,
        deep: bool,
        slack: float,
        options: Options,
    ) -> Series:
        signal, frames = SIGNALS[name], len(self.episode)
        dimension = signal.variant(dict(options)).dimension
        groups = tuple((body,) if signal.joints else tuple(self.bodies(body)) for body in bodies)
        missing = [body for body, group in zip(bodies, groups, strict=True) if not group]
        if missing:
            return unknown(frames, dimension, f"the trace has no {' and no '.join(missing)}")
        request = Request(
            self, signal, dimension, bodies, groups, reference, cap, deep, slack, options
        )
        return self._without_gaps(mask_unseen(signal.measure(request), request), request)

    def _without_gaps(self, found: Series, request: Request) -> Series:
        """Return the series, unknown where a value that it is measured from was not recorded."""
        lost = gap_of(request)
        lower, upper = found.lower, found.upper
        if np.isnan(lower).any() or np.isnan(upper).any():
            nan = np.isnan(lower) | np.isnan(upper)
            lost = nan if lost is None else lost | nan
        if lost is None:
            return found
        note = f"{request.name}({', '.join(request.bodies)}) was not measured at every frame"
        return hidden(found, lost, note)
