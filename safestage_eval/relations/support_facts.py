"""Touches, support and grips of one episode: the facts behind relations and their signals."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.measure import Signals

from .dependence import Dependence
from .firmness import Loads
from .graph import ByForce, SupportGraph, faint
from .held import gripper_frame
from .proximity import Proximity

Bool = NDArray[np.bool_]


class Support:
    """Who touches, supports and holds whom in one episode; each computed once, when first needed."""

    def __init__(self, signals: Signals) -> None:
        """Share the signals' contact sums and shapes."""
        self.signals, self.episode = signals, signals.episode

    @cached_property
    def blind(self) -> bool:
        """The trace has no contact forces: touch and support are inferred from geometry."""
        return not self.signals.gaps.forces

    @cached_property
    def proximity(self) -> Proximity:
        """Who is near whom."""
        return Proximity(self.episode, self.signals.movers)

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
    def dependence(self) -> Dependence:
        """Who falls without whom."""
        return Dependence(self.episode, self.signals.contact_sums, self.graph, self.signals.gaps)

    @cached_property
    def loads(self) -> Loads:
        """Who carries how much of whom."""
        return Loads(self.episode, self.signals.contact_sums, self.graph, self.signals.movers)

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

    @cached_property
    def hand(self) -> str | None:
        """The body whose frame is the hand's, if it is known."""
        return gripper_frame(self.episode)

    @cached_property
    def fingers_seen(self) -> bool:
        """Shapes of both fingers are known."""
        seen = {body.finger for body in self.episode.header.bodies if body.geoms}
        return {"left", "right"} <= seen

    def borne(self, body: int) -> Bool:
        """(T,) some body other than the robot bears it."""
        nothing = np.zeros(len(self.episode), np.bool_)
        bearers = self.graph.bearers(body).values()
        return np.asarray(np.logical_or.reduce([nothing, *bearers]))
