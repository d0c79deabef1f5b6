"""All signals of one episode, each measured once, when it is first asked for; unknown where it was not measured."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode
from safestage_eval.geometry.gjk import PROMISED
from safestage_eval.geometry.group_clearance import SLACK, Clearance, motion_bound

from .declare import SIGNALS, Options
from .facts import Facts, Request
from .intervals import Bool, Interval, hidden
from .missing_values import POSE, around, either
from .motion import before, derived
from .reference import Reference

CAP = 0.10
"""m: a clearance series is exact up to here; beyond, it says only "more than that"."""


def how(name: str, reach: float, limits: Sequence[float]) -> tuple[float, bool, float]:
    """Cap, depth and slack with which a signal is measured for limits; see ``Signals.get``."""
    if not SIGNALS[name].capped:
        return 0.0, False, 0.0
    deep = min(limits, default=1.0) <= 0
    return max(reach, CAP), deep, SLACK if limits else 0.0


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


@dataclass(frozen=True, eq=False)
class Partial:
    """Bounds (T,), which frames are done (T,), and what was noted.

    Attributes:
        lower, upper: unknown where it is not measured yet.
        done: where it is.
        notes: note → (T,) the frames that it is about.
    """

    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    done: Bool
    notes: dict[str, Bool]

    @classmethod
    def blank(cls, frames: int) -> Partial:
        """Nothing measured yet."""
        return cls(
            np.full(frames, -np.inf), np.full(frames, np.inf), np.zeros(frames, np.bool_), {}
        )

    def missing(self, wanted: Bool) -> NDArray[np.int64]:
        """The wanted frames (T,) that are still to be measured."""
        return np.flatnonzero(wanted & ~self.done)

    def add(self, at: NDArray[np.int64], found: Interval) -> None:
        """Measurements at N frames, with a note on those that are unknown, if any."""
        self.lower[at], self.upper[at] = found.lower, found.upper
        self.done[at] = True
        vague = np.isneginf(found.lower) & np.isposinf(found.upper)
        for note in found.notes:
            about = self.notes.setdefault(note, np.zeros(len(self.done), np.bool_))
            about[at[vague] if vague.any() else at] = True

    def series(self, wanted: Bool, dimension: str) -> Interval:
        """All that is known, with the notes about the wanted frames (T,)."""
        notes = tuple(note for note, about in self.notes.items() if (about & wanted).any())
        return Interval(self.lower, self.upper, dimension, notes)


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
