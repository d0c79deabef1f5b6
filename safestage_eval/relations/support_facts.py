"""Touches, support and grips of one episode: the facts behind relations and their signals."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.contact_sums import ContactSums
from safestage_eval.evidence.measure import Signals
from safestage_eval.geometry.cavity import inside_parts

from .dependence import Dependence
from .firmness import Loads
from .graph import LEAST_SHARE, ByForce, SupportGraph, faint
from .held import Grip, by_fingers, by_motion, by_pressure, gripper_frame, may_differ
from .proximity import LIFT, TOUCH, Proximity

Bool = NDArray[np.bool_]

PRESSED = 0.1
"""N. Whoever presses on a body with this, as much as a contact takes, has a hand in how it stands."""


class Support:
    """Who touches, supports and holds whom in one episode; each computed once, when first needed."""

    def __init__(self, signals: Signals) -> None:
        """Share the signals' store, contact sums and shapes."""
        self.signals, self.store = signals, signals.store
        self.episode = signals.episode
        self._grips: dict[int, Grip] = {}

    @cached_property
    def blind(self) -> bool:
        """The trace has no contact forces: touch and support are inferred from geometry."""
        gaps, query = self.signals.gaps, self.signals.query("recorded", "forces")
        gaps.forces = self.store.value(query, lambda _: gaps.forces)
        return not gaps.forces

    @cached_property
    def proximity(self) -> Proximity:
        """Who is near whom."""
        return Proximity(self.episode, self.signals.movers)

    @property
    def touches(self) -> ContactSums | Proximity:
        """Who touches whom: by forces if there are any."""
        return self.proximity if self.blind else self.signals.contact_sums

    @cached_property
    def graph(self) -> SupportGraph:
        """Who bears whom."""
        if self.blind:
            return SupportGraph(self.episode, self.proximity)
        return SupportGraph(self.episode, ByForce(self.episode, self.signals.contact_sums))

    @cached_property
    def unweighed(self) -> list[str]:
        """Free bodies whose mass is missing: no recorded force tells what bears them."""
        if self.blind:
            return []
        bodies = self.episode.header.bodies
        return [
            bodies[i].name for i in sorted(self.graph.assemblies.free) if bodies[i].mass is None
        ]

    @cached_property
    def faint(self) -> list[str]:
        """Free bodies so light that rounding of the recorded forces may hide what bears them."""
        return [] if self.blind else faint(self.episode, self.signals.contact_sums)

    @cached_property
    def sure_graph(self) -> SupportGraph:
        """Who certainly bears whom."""
        return SupportGraph(
            self.episode, ByForce(self.episode, self.signals.contact_sums, sure=True)
        )

    @cached_property
    def dependence(self) -> Dependence:
        """Who falls without whom."""
        return Dependence(self.episode, self.signals.contact_sums, self.graph, self.signals.gaps)

    @cached_property
    def loads(self) -> Loads:
        """Who carries how much of whom."""
        return Loads(self.episode, self.signals.contact_sums, self.graph, self.signals.movers)

    def lies_inside(self, body: str, container: str, bears: Bool) -> Bool | None:
        """(T,) a body's lowest point is in a cavity, and its centroid too or the container ``bears`` it.

        False without a declared cavity; None for a body without a shape.
        """
        frames, movers = len(self.episode), self.signals.movers
        cavity = self.episode.bodies[container].cavity
        if cavity is None:
            return np.zeros(frames, np.bool_)
        if not movers.of([body]):
            return None
        low, centroid = inside_parts(movers[body], movers[container], cavity)
        return np.broadcast_to(low & (centroid | bears), frames)

    @cached_property
    def bearers_unseen(self) -> bool:
        """Without forces: the shape of some body that is no robot is missing; it may bear others."""
        names = [b.name for b in self.episode.header.bodies if b.kind not in ("robot", "gripper")]
        return self.blind and bool(self.signals.movers.unseen(names))

    def lacks_forces(self, names: tuple[str, ...]) -> str:
        """Forces and shapes, where there are none of either; else nothing.

        A union may have mere frames: they have no shape to miss.
        """
        if not self.blind:
            return ""
        movers, missing = self.signals.movers, list[str]()
        for bodies in map(self.signals.bodies, names):
            missing += movers.unseen(bodies) if movers.of(bodies) else bodies
        return f"contact forces and no shape of {', '.join(missing)}" if missing else ""

    def lacks_hand(self) -> str:
        """The facts about the robot's hand that are missing to decide what it holds; empty if none."""
        bodies = self.episode.header.bodies
        if not any(body.kind == "gripper" for body in bodies):
            return "poses of the robot's hand" if any("links" in b.untold for b in bodies) else ""
        if not self.blind and not {"left", "right"} <= {body.finger for body in bodies}:
            return "names of the left and the right finger"
        if self.blind and not self.fingers_seen and self.hand is None:
            return "contact forces, and does not say which body is the gripper"
        return ""

    def lacks_shapes_of_robot(self) -> str:
        """Without forces: the shapes of the robot that are missing to see what it touches."""
        if not self.blind:
            return ""
        robot = [b.name for b in self.episode.header.bodies if b.kind in ("robot", "gripper")]
        missing = self.signals.movers.unseen(robot)
        return f"contact forces and no shape of {', '.join(missing)}" if missing else ""

    def lacks_masses(self, on: str) -> str:
        """Masses of the bodies near one that may be taken away."""
        if not self.unweighed:
            return ""
        near = self.dependence.beside(self.episode.body_index[on])
        return ", ".join(f"mass of {body}" for body in self.unweighed if body in near)

    by_geometry = (
        f"by geometry: within {TOUCH * 1e3:g} mm, and a lift by {LIFT * 1e3:g} mm opens the gap"
    )
    """How support is decided without forces."""

    by_touch = f"by geometry: a touch is a distance of at most {TOUCH * 1e3:g} mm"
    """How touches are decided without forces."""

    @cached_property
    def hand(self) -> str | None:
        """The body whose frame is the hand's, if it is known."""
        return gripper_frame(self.episode)

    @cached_property
    def fingers_seen(self) -> bool:
        """Shapes of both fingers are known."""
        seen = {body.finger for body in self.episode.header.bodies if body.geoms}
        return {"left", "right"} <= seen

    def may_touch(self, i: int, j: int) -> Bool:
        """(T,) the two touch at the frame or did since the one before, or their force is not known."""
        sums = self.signals.contact_sums
        touching, lost = np.asarray(sums.peak(i, j) > 0), sums.unknown(i, j)
        return touching if lost is None else touching | lost

    def grip_open(self, body: int, at: Bool) -> Bool:
        """(T,) at these frames ``at`` (T,) it hangs on forces that are not known whether it is held."""
        return may_differ(self.episode, body, self.touches.beside(body), at, self.held(body))

    def held(self, body: int) -> Bool:
        """(T,) held by the fingers; without forces and fingers' shapes, by moving along."""
        return self._grip(body).sure

    def may_be_held(self, body: int) -> Bool:
        """(T,) false only where it is certainly not held."""
        return self._grip(body).perhaps

    def may_be_grasped(self, body: int) -> Bool:
        """(T,) as ``may_be_held``, and while a hand that will take it along is with it already."""
        return self._grip(body).grasped | self._grip(body).perhaps

    def _grip(self, body: int) -> Grip:
        if body not in self._grips:
            self._grips[body] = self._gripped(body)
        return self._grips[body]

    def _gripped(self, body: int) -> Grip:
        shaped = bool(self.episode.header.bodies[body].geoms)
        if not self.blind or (self.fingers_seen and shaped):
            if self.blind:
                return by_fingers(self.episode, body, self.proximity)
            pressed = by_pressure(self.episode, body, self.touches.beside(body))
            return Grip(pressed, pressed, pressed)
        if self.hand is None or not self.episode.header.bodies[body].movable:
            nothing = np.zeros(len(self.episode), np.bool_)
            return Grip(nothing, nothing, nothing)
        return by_motion(self.episode, body, self.hand, self.borne(body))

    def hands_at(self, body: int, held: Callable[[int], Bool]) -> dict[int, Bool]:
        """Body → (T,) true where the robot has it, of those that ever touch one: its own links always.

        ``held``: (T,) of a body. What holds still (its base, a table) has nobody.
        """
        hands, assemblies = {}, self.graph.assemblies
        for other in self.touches.beside(body):
            if other in assemblies.robot or assemblies.on_robot(other):
                hands[other] = np.ones(len(self.episode), np.bool_)
            elif other in assemblies.free:
                hands[other] = held(other) | self.graph.carried(other, held)
        return {other: has for other, has in hands.items() if has.any()}

    def leaned_on(self, body: int, held: Callable[[int], Bool]) -> Bool:
        """(T,) the robot and what it has press on a body; without forces they go into it."""
        total, hands = np.zeros(len(self.episode)), self.hands_at(body, held)
        if self.blind:
            for other, has in hands.items():
                rows = np.flatnonzero(has & self.proximity.touching(body, other))
                if len(rows):
                    total[rows] += self.proximity.gap(body, other, rows).upper < -TOUCH
            return total > 0
        mass = self.episode.header.bodies[body].mass
        weight = (mass or 0.0) * float(np.linalg.norm(self.episode.header.gravity))
        for other, has in hands.items():
            total += np.where(has, self.signals.contact_sums.normal(body, other), 0.0)
        return total >= min(PRESSED, LEAST_SHARE * weight or PRESSED)

    def borne(self, body: int) -> Bool:
        """(T,) some body other than the robot bears it."""
        nothing = np.zeros(len(self.episode), np.bool_)
        bearers = self.graph.bearers(body).values()
        return np.asarray(np.logical_or.reduce([nothing, *bearers]))
