"""All signals of one episode, each measured once, when it is first asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode
from safestage_eval.evidence.query import Growth, Kind, Query
from safestage_eval.evidence.store import Store
from safestage_eval.geometry.clearance import SLACK, Clearance, motion_bound
from safestage_eval.geometry.gjk import PROMISED

from . import (
    channel,
    damage,
    distance,
    force,
    gripper,
    joint,
    motion,
    self_clearance,
    stretch,
    workspace,
)
from .facts import Facts
from .facts import Query as Request
from .gaps import POSE, around
from .options import Options
from .reference import Reference
from .series import Series, exact, hidden, unknown
from .unseen import looks_over, mask_unseen
from .vocabulary import SIGNALS

CAP = 0.10
"""m: a clearance series is exact up to here; beyond, it says only "more than that"."""

CAPPED = ("clearance", "clearance_xy", "self_clearance")

LOCAL = (
    "contact_force", "peak_force", "total_force", "clearance", "clearance_xy", "self_clearance",
    "height_above", "containment_depth", "workspace_margin", "gripper_opening", "joint_torque",
    "joint_opening", "channel",
)  # fmt: skip
"""Signals whose value at a frame depends on that frame alone. The others come from poses, twists and
sums of forces by plain arithmetic over all frames, or add up what was."""

DIFFERENCES = (
    "speed", "vertical_speed", "angular_speed", "relative_speed", "joint_speed",
    "impact", "quasistatic_force", "damage", "health",
)  # fmt: skip
"""Signals that, where no velocities were recorded (and a note says so), look one frame ahead."""


def growth(name: str) -> Growth:
    """How a signal changes when the episode grows."""
    if name in LOCAL:
        return Growth.PER_FRAME
    return Growth.OPEN_END if name in DIFFERENCES else Growth.WHOLE


def how(name: str, reach: float, limits: Sequence[float]) -> tuple[float, bool, float]:
    """Cap, depth and slack with which a signal is measured for limits; see ``Signals.get``."""
    if name not in CAPPED:
        return 0.0, False, 0.0
    deep = min(limits, default=1.0) <= 0
    return max(reach, CAP), deep, SLACK if limits and not deep else 0.0


ORIENTED = ("turn", "tilt", "angular_speed")
"""Signals that need no position."""

FORCES = ("contact_force", "peak_force", "total_force", "impulse")
"""Signals of forces alone: what is unknown of these they know themselves."""

MOVING = (
    "speed",
    "vertical_speed",
    "relative_speed",
    "impact",
    "quasistatic_force",
    "damage",
    "health",
)
"""Signals of the velocity of the centre of mass."""


def gap_of(query: Request) -> NDArray[np.bool_] | None:
    """(T,) where something that a signal is measured from was not measured; None if nowhere."""
    gaps, episode, name = query.facts.gaps, query.episode, query.name
    if SIGNALS[name].joints or name in (*FORCES, "gripper_opening", "channel"):
        return gaps.unseen
    found = gaps.unseen
    for body in {body for group in query.groups for body in group}:
        lost = _gap_of_body(query, episode.bodies[body])
        if lost is not None:
            found = lost if found is None else found | lost
    if name == "self_clearance":
        robot = [b.name for b in episode.header.bodies if b.kind in ("robot", "gripper")]
        found = gaps.of_bodies(robot)
    if found is None:
        return None
    if name == "health":
        return gaps.unseen  # it adds up: what is lost widens all that follows
    if name in ("impact", "quasistatic_force", "damage"):
        found = damage.touched_by(query, found)
    if looks_over(query):
        found = damage.lost_since(motion.before(episode.t, query.option("over")), found)
    if name in CHANGES and (name != "height" or query.since is not None):
        found = _of_reference(query, found)
    return found


CHANGES = ("lift", "displacement", "displacement_xy", "turn", "height")
"""Signals that are measured from a reference."""


def _of_reference(query: Request, lost: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The same, with the frames of which the reference was not measured."""
    reference = query.reference
    first = lost[reference.baseline.stretch]
    whole = bool(2 * first.sum() > len(first))  # most of it is missing
    if reference.since is None:
        return lost | whole
    since = reference.since
    return lost | np.where(since < 0, whole, lost[np.maximum(since, 0)])


def _gap_of_body(query: Request, body: Body) -> NDArray[np.bool_] | None:
    gaps, name = query.facts.gaps, query.name
    offset = any(body.com)
    if name == "tilt":
        return None if body.up_axis is None else gaps.of_body(body.name, ("orientation",))
    if name in ORIENTED:
        columns: tuple[str, ...] = ("orientation",)
    elif (name in CHANGES and name != "lift") or looks_over(query):
        columns = POSE if offset else ("position",)
    elif name in MOVING:
        columns = ("position", "orientation", "angular_velocity") if offset else ("position",)
    elif body.geoms:
        columns = POSE
    else:
        return None
    if looks_over(query) or (name not in MOVING and name != "angular_speed"):
        return gaps.of_body(body.name, columns)
    # derived from poses where no velocity was recorded, else taken as it is
    column = "angular_velocity" if name == "angular_speed" else "linear_velocity"
    recorded = gaps.of_body(body.name, (column,))
    if not motion.derived(query.episode, body.name, column):
        more = ("orientation", "angular_velocity") if offset and name in MOVING else ()
        other = gaps.of_body(body.name, more)
        return other if recorded is None else recorded if other is None else recorded | other
    lost = gaps.of_body(body.name, columns)
    return None if lost is None else around(lost)


def loose(found: Series, cap: float) -> Clearance:
    """The frames at which slack was taken: hardly ever any, and they do not change."""
    at = (found.upper - found.lower > PROMISED) & (found.lower < cap)
    return Clearance(found.lower[at], found.upper[at])


MEASURES: dict[str, Callable[[Request], Series]] = {
    "height": motion.height,
    "lift": distance.lift,
    "displacement": motion.displacement,
    "displacement_xy": motion.displacement,
    "remoteness": motion.remoteness,
    "turn": motion.turn,
    "tilt": motion.tilt,
    "speed": motion.speed,
    "vertical_speed": motion.vertical_speed,
    "angular_speed": motion.angular_speed,
    "relative_speed": motion.relative_speed,
    "contact_force": force.between,
    "peak_force": force.between,
    "total_force": force.between,
    "impulse": force.impulse,
    "impact": damage.impact,
    "quasistatic_force": damage.quasistatic_force,
    "damage": damage.damage,
    "health": damage.health,
    "clearance": distance.clearance,
    "clearance_xy": distance.clearance,
    "height_above": distance.height_above,
    "containment_depth": distance.containment,
    "self_clearance": self_clearance.clearance,
    "workspace_margin": workspace.margin,
    "gripper_opening": gripper.opening,
    "joint_torque": joint.torque,
    "joint_speed": joint.speed,
    "joint_opening": joint.opening,
    "channel": channel.value,
}
"""Signal → how it is measured; those that need the support graph are in ``relations.measure``."""


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
            name: as in ``vocabulary.SIGNALS``.
            bodies: names of bodies or unions, in the signal's order.
            reference: for signals that measure a change; the baseline if None.
            reach: m, for clearances: distances up to here are wanted exactly.
            options: what the signal's definition adds, sorted by name.
            limits: m, for clearances: all that they are compared with. Bounds may then be 10 µm
                wider where they leave no limit open; depths are measured for limits up to 0.
                Without limits, bounds are as tight as they can be.

        Raises KeyError for a name or body that does not exist.
        """
        if name not in CAPPED:
            return self.measured(name, tuple(bodies), reference, 0.0, False, 0.0, options)
        cap, deep, slack = how(name, reach, limits)
        found = self.measured(name, tuple(bodies), reference, cap, deep, slack, options)
        if slack and any(self._loose(found, cap).leaves_open(x) for x in limits):
            found = self.measured(name, tuple(bodies), reference, cap, deep, 0.0, options)
        return found

    def stretch(
        self,
        name: str,
        bodies: tuple[str, ...],
        reference: Reference | None,
        options: Options,
        frames: slice,
    ) -> Series | None:
        """(N,) as ``get``, of some neighbouring frames, measured at these alone.

        None where the signal needs others, or depends on how a body is made.
        """
        if name not in stretch.SIGNALS or options or bodies[0] not in self.episode.bodies:
            return None
        if self.gaps.of_bodies(bodies[:1]) is not None:
            return None
        since = reference.key if reference else ""
        known = self.store.known(self.query("signal", name, bodies, since))
        if known is not None:
            lower = known.lower[frames]
            upper = lower if known.upper is known.lower else known.upper[frames]
            return Series(lower, upper, known.dimension, known.notes)
        found = stretch.at_frames(self, name, bodies[0], reference, frames)
        return None if found is None else exact(found, SIGNALS[name].dimension)

    def _loose(self, found: Series, cap: float) -> Clearance:
        if id(found) not in self._slack:
            self._slack[id(found)] = found, loose(found, cap)
        return self._slack[id(found)][1]

    def between_frames(self, name: str, bodies: Sequence[str], frame: int) -> float | None:
        """How much further (m) the value may have gone between the frame and its neighbours.

        Half the bound on the relative motion over one recorded step: for distances only, None for
        other signals.
        """
        if name not in CAPPED:
            return None
        query = self.query("between frames", name, tuple(bodies), frame=frame)
        found: float = self.store.value(query, lambda _: self._between(name, bodies, frame))
        return found

    def _between(self, name: str, bodies: Sequence[str], frame: int) -> float:
        if name == "self_clearance":
            pairs = self_clearance.facing(self)
        else:
            first, second = (self.movers.of(self.bodies(body)) for body in bodies)
            pairs = [(a, b) for a in first for b in second]
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
        """As measured, once: ``cap``, ``deep`` and ``slack`` as in ``evidence.query.Query``."""

        def measure(near: Any) -> Series:
            signals: Signals = self if near is None else near.signals
            return signals._measure(name, bodies, reference, cap, deep, slack, options)

        since = reference.key if reference else ""
        query = self.query("signal", name, bodies, since, cap, deep, slack, options)
        return self.store.series(query, measure, growth(name))

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
        spec, frames = SIGNALS[name].variant(dict(options)), len(self.episode)
        dimension = spec.dimension
        groups = tuple((body,) if spec.joints else tuple(self.bodies(body)) for body in bodies)
        missing = [body for body, group in zip(bodies, groups, strict=True) if not group]
        if missing:
            return unknown(frames, dimension, f"the trace has no {' and no '.join(missing)}")
        query = Request(self, name, dimension, bodies, groups, reference, cap, deep, slack, options)
        return self._without_gaps(mask_unseen(MEASURES[name](query), query), query)

    def _without_gaps(self, found: Series, query: Request) -> Series:
        """The same, unknown where something that it is measured from was not measured."""
        lost = gap_of(query)
        lower, upper = found.lower, found.upper
        if np.isnan(lower).any() or np.isnan(upper).any():
            nan = np.isnan(lower) | np.isnan(upper)
            lost = nan if lost is None else lost | nan
        if lost is None:
            return found
        note = f"{query.name}({', '.join(query.bodies)}) was not measured at every frame"
        return hidden(found, lost, note)
