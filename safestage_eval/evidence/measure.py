"""All signals of one episode, each measured once, when it is first asked for."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.geometry.gjk import PROMISED
from safestage_eval.geometry.group_clearance import SLACK, Clearance, motion_bound

from .declare import SIGNALS, Options
from .facts import Facts, Request
from .intervals import Interval
from .reference import Reference
from .unseen import known_part

CAP = 0.10
"""m: a clearance series is exact up to here; beyond, it says only "more than that"."""


def how(name: str, reach: float, limits: Sequence[float]) -> tuple[float, bool, float]:
    """Cap, depth and slack with which a signal is measured for limits; see ``Signals.get``."""
    if not SIGNALS[name].capped:
        return 0.0, False, 0.0
    deep = min(limits, default=1.0) <= 0
    return max(reach, CAP), deep, SLACK if limits and not deep else 0.0


def loose(found: Interval, cap: float) -> Clearance:
    """The frames at which slack was taken: hardly ever any, and they do not change."""
    at = (found.upper - found.lower > PROMISED) & (found.lower < cap)
    return Clearance(found.lower[at], found.upper[at])


class Signals(Facts):
    """Signals of an episode by name and bodies, in SI, each an ``Interval`` over all frames."""

    def __init__(self, episode: Episode, baseline_frames: int = 5) -> None:
        """Arguments as ``Facts``."""
        super().__init__(episode, baseline_frames)
        self.known: dict[Hashable, Any] = {}
        """Measurements so far, by name, bodies and settings; relations are kept here, too."""
        # by identity: the series is kept beside what was found
        self._slack: dict[int, tuple[Interval, Clearance]] = {}

    def get(
        self,
        name: str,
        bodies: Sequence[str] = (),
        reference: Reference | None = None,
        reach: float = CAP,
        options: Options = (),
        limits: Sequence[float] = (),
    ) -> Interval:
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

    def _loose(self, found: Interval, cap: float) -> Clearance:
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
        near = slice(max(frame - 1, 0), frame + 2)
        pairs = self.pairs_between(bodies)
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
    ) -> Interval:
        """Measure once: ``cap``, ``deep`` and ``slack`` as in ``Request``."""
        key = (name, bodies, reference.key if reference else "", cap, deep, slack, options)
        if key not in self.known:
            self.known[key] = self._measure(name, bodies, reference, cap, deep, slack, options)
        found: Interval = self.known[key]
        return found

    def _measure(
        self,
        name: str,
        bodies: tuple[str, ...],
        reference: Reference | None,
        cap: float,
        deep: bool,
        slack: float,
        options: Options,
    ) -> Interval:
        request = self.request(name, bodies, reference, cap, deep, slack, options)
        pairs = zip(bodies, request.groups, strict=True)
        missing = [body for body, group in pairs if not group]
        if missing:
            return request.unknown(f"the trace has no {' and no '.join(missing)}")
        return known_part(request.signal.measure(request), request)

    def request(
        self,
        name: str,
        bodies: tuple[str, ...],
        reference: Reference | None,
        cap: float = 0.0,
        deep: bool = False,
        slack: float = 0.0,
        options: Options = (),
        relations: Any = None,
        at: NDArray[np.int64] | None = None,
    ) -> Request:
        """The request that a signal's function takes; arguments as in ``Request``, ``at`` None: all frames."""
        signal = SIGNALS[name]
        groups = tuple((body,) if signal.joints else tuple(self.bodies(body)) for body in bodies)
        dimension = signal.variant(dict(options)).dimension
        at = np.arange(len(self.episode)) if at is None else at
        return Request(
            self, signal, dimension, bodies, groups, reference, cap, deep, slack, options,
            relations, at,
        )  # fmt: skip
