"""All relations of one episode, and the signals that need the support graph."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from safestage_eval.geometry.cavity import inside_parts
from safestage_eval.signals.contact_sums import ContactSums
from safestage_eval.signals.measure import Signals
from safestage_eval.signals.options import Options
from safestage_eval.signals.reference import Reference
from safestage_eval.signals.series import Series, hidden, hide, unknown
from safestage_eval.signals.vocabulary import SIGNALS

from . import between, doubt, effect, falls, standing, unmeasured
from .dependence import Dependence
from .exposure import Causes, Exposure
from .graph import ByForce, SupportGraph, faint
from .held import Grip, by_fingers, by_motion, by_pressure
from .load import Loads
from .partial import Partial
from .proximity import LIFT, TOUCH, Proximity
from .slip import gripper_frame, slip
from .vocabulary import RELATIONS

Bool = NDArray[np.bool_]


MEASURES: dict[str, Callable[..., Series]] = {
    "edge_margin": standing.edge,
    "overlap_xy": standing.overlap,
    "support_margin": standing.support_margin,
    "tipping_angle": standing.tipping_angle,
}
"""Signal → how it is measured at chosen frames."""

COSTLY = (*MEASURES, "depends_on")
"""What clips polygons or solves statics: found out only at the frames that matter."""


class Relations:
    """Relations of an episode by name and bodies: (T,) true or false, or unknown throughout."""

    found_out = 0
    """How often something ``COSTLY`` was found out."""

    def __init__(self, signals: Signals) -> None:
        """Shares the signals' cache of contact sums and shapes."""
        self.signals = signals
        self.episode = signals.episode
        self._known: dict[tuple[str, tuple[str, ...]], Bool | None] = {}
        self._partial: dict[tuple[str, tuple[str, ...], Options], Partial] = {}
        self._grips: dict[int, Grip] = {}
        self._falls: dict[str, Series] = {}
        self._peaks: dict[tuple[str, ...], Series] = {}
        signals.untouched = self._untouched

    @cached_property
    def blind(self) -> bool:
        """The trace has no contact forces: touch and support are told by geometry."""
        return not self.signals.gaps.forces

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
        return Dependence(self.episode, self.signals.contact_sums, self.graph)

    def caught(self, body: str, on: str, wanted: Bool | None) -> Bool:
        """(T,) it is open whether something would catch ``body`` when ``on`` is taken away."""
        index = self.episode.body_index
        return self.dependence.depends_on(index[body], index[on], wanted)[1]

    def told(self, body: str, on: str) -> Bool:
        """(T,) where it is known already whether ``body`` falls when ``on`` is taken away."""
        if self.blind:
            return np.ones(len(self.episode), np.bool_)
        index = self.episode.body_index
        return self.dependence.told(index[body], index[on])

    @cached_property
    def exposure(self) -> Exposure:
        """Who has touched whom, directly or not."""
        return Exposure(self.episode, self.touches.beside, self.touches.touching)

    @cached_property
    def causes(self) -> Causes:
        """Since when the robot has had to do with whom."""
        return Causes(self)

    @property
    def chained(self) -> bool:
        """Answers so far hang on contacts between any bodies: that some did not touch is one of them.

        Who was exposed to whom, and who moved though the robot had nothing to do with it.
        """
        if self.blind:
            return False
        known = vars(self)
        return "exposure" in known or ("causes" in known and self.causes.unexplained())

    def _untouched(self, name: str) -> int:
        """Up to which frame the robot has certainly had nothing to do with a body."""
        if self.lacking("caused"):
            return len(self.episode)
        return self.causes.perhaps_since(self.episode.body_index[name])

    @cached_property
    def loads(self) -> Loads:
        """Who carries how much of whom."""
        return Loads(self.episode, self.signals.contact_sums, self.graph)

    def get(self, name: str, bodies: Sequence[str], wanted: Bool | None = None) -> Bool | None:
        """(T,) truth of one relation; None where the trace lacks what it needs.

        Of a ``COSTLY`` one only the ``wanted`` frames (T,) mean anything; all of them if None.
        Raises KeyError for a name or body that does not exist.
        """
        if self.lacking(name, bodies):
            return None
        if name == "depends_on" and not self.blind:
            ids = [self.episode.body_index[body] for body in bodies]
            told = self.dependence.told(*ids)
            self.found_out += not bool((told if wanted is None else told | ~wanted).all())
            return self.dependence.depends_on(ids[0], ids[1], wanted)[0]
        key = (name, tuple(bodies))
        if key not in self._known:
            self._known[key] = self.decide(name, list(bodies))
        return self._known[key]

    def lacking(self, name: str, bodies: Sequence[str] = ()) -> str:
        """What the trace would need to tell a relation, and does not have; empty if nothing."""
        if name == "inside" and bodies and "cavity" in self.episode.bodies[bodies[1]].untold:
            return f"inside of {bodies[1]}"
        if "touch" not in RELATIONS[name].needs:
            return ""
        header = self.episode.header
        if name == "caused":
            return "" if self.graph.assemblies.robot else "poses of the robot"
        if self.blind:
            shapeless = [b for body in bodies for b in self._shapeless(body)]
            if shapeless and name != "held":
                return f"contact forces and no shape of {', '.join(shapeless)}"
        if name in ("held", "carried") and self._hand_untold:
            return "poses of the robot's hand"
        if name in ("held", "carried") and any(body.kind == "gripper" for body in header.bodies):
            fingers = {body.finger for body in header.bodies}
            if not self.blind and not {"left", "right"} <= fingers:
                return "names of the left and the right finger"
            if self.blind and not self._fingers_seen and self._hand is None:
                return "contact forces, and does not say which body is the gripper"
        if name == "depends_on" and bodies and self.unweighed:
            near = self.dependence.beside(self.episode.body_index[bodies[1]])
            return ", ".join(f"mass of {body}" for body in self.unweighed if body in near)
        return ""

    @cached_property
    def _hand_untold(self) -> bool:
        """The robot has a hand, and its poses are not recorded."""
        bodies = self.episode.header.bodies
        hands = any(body.kind == "gripper" for body in bodies)
        return not hands and any("links" in body.untold for body in bodies)

    def _shapeless(self, name: str) -> list[str]:
        """Bodies of that name or union whose shape is missed; a union may have mere frames."""
        bodies, movers = self.signals.bodies(name), self.signals.movers
        return movers.unseen(bodies) if movers.of(bodies) else bodies

    def doubtful(
        self, name: str, bodies: Sequence[str], wanted: Bool | None = None
    ) -> tuple[Bool, str] | None:
        """(T,) true where the trace does not tell a relation, whatever ``get`` says; and why.

        None where there is no doubt at any frame. ``wanted``: as in ``get``.
        """
        found = doubt.by_nature(self, name, bodies, wanted)
        lost = self.unmeasured(name, tuple(bodies))
        if lost is None:
            return found
        why = f"{name}({', '.join(bodies)}) was not measured at every frame"
        return (lost, why) if found is None else (lost | found[0], f"{why}; {found[1]}")

    def unmeasured(self, name: str, bodies: tuple[str, ...]) -> Bool | None:
        """(T,) true where something that a relation rests on was not measured; None if nowhere.

        Of forces, what was read so far counts: ``get`` comes first.
        """
        found = unmeasured.lost_by(self, name, bodies)
        if (
            name not in ("supported", "carried", "depends_on", "exposed_to")
            or not self.bearers_unseen
        ):
            return found
        truth = self.get(name, bodies)
        if truth is None or truth.all():
            return found
        return ~truth if found is None else found | ~truth

    @cached_property
    def bearers_unseen(self) -> bool:
        """Without forces: the shape of some body that is no robot is missing; it may bear others."""
        names = [b.name for b in self.episode.header.bodies if b.kind not in ("robot", "gripper")]
        return self.blind and bool(self.signals.movers.unseen(names))

    def caveat(self, name: str) -> tuple[str, ...]:
        """What the reader should be told of a relation that is known by other means than forces."""
        if not self.blind or "touch" not in RELATIONS[name].needs:
            return ()
        near, lift = f"{TOUCH * 1e3:g} mm", f"{LIFT * 1e3:g} mm"
        how = {
            "held": "by the shapes of both fingers"
            if self._fingers_seen
            else "by what goes along with the gripper",
            "depends_on": "by what rests on what: needless supports count; "
            "what touches from the side may lean or not",
            "caused": f"by geometry: a touch is a distance of at most {near}",
            "exposed_to": f"by geometry: a touch is a distance of at most {near}",
        }.get(name, f"by geometry: within {near}, and a lift by {lift} opens the gap")
        return (f"without contact forces {name}() is told {how}",)

    def signal(
        self,
        name: str,
        bodies: Sequence[str],
        reference: Reference | None = None,
        reach: float = 0,
        wanted: Bool | None = None,
        options: Options = (),
        limits: Sequence[float] = (),
    ) -> Series:
        """Any signal: those of ``signals``, and those that need the support graph.

        The ``COSTLY`` ones are measured at the ``wanted`` frames (T,) only, and are unknown at the
        others; every frame is measured at most once. ``limits``: as in ``Signals.get``.
        """
        if name == "slip":  # since a grasp that may have been lost in a hole
            found = self._known_part(name, bodies, self._slip(bodies[0], reference))
            unseen = self.episode.unseen
            return found if unseen is None else hide(found, np.logical_or.accumulate(unseen))
        if name == "load_share":
            return self._known_part(name, bodies, self._load_share(*bodies))
        if name in effect.SIGNALS:
            found = effect.measure(self, name, bodies, dict(options).get("over"))
            return self._known_part(name, bodies, found)
        if name == "fall":
            if bodies[0] not in self._falls:
                self._falls[bodies[0]] = falls.fallen(self, bodies[0])
            return self._known_part(name, bodies, self._falls[bodies[0]])
        if name == "peak_force":
            key = tuple(bodies)
            if key not in self._peaks:
                found = self.signals.get(name, bodies)
                self._peaks[key] = between.with_missed_peaks(self, bodies, found)
            return self._peaks[key]
        if name not in MEASURES:
            return self.signals.get(name, bodies, reference, reach, options, limits)
        key = (name, tuple(bodies), options)
        if key not in self._partial:
            self._partial[key] = Partial.blank(len(self.episode))
        partial = self._partial[key]
        todo = np.ones(len(self.episode), np.bool_) if wanted is None else wanted
        missing = partial.missing(todo)
        if len(missing):
            self.found_out += 1
            partial.add(missing, self.measure(name, missing, bodies, options))
        return self._known_part(name, bodies, partial.series(todo, SIGNALS[name].dimension))

    def _known_part(self, name: str, bodies: Sequence[str], found: Series) -> Series:
        """The same, unknown where something that it may rest on was not measured."""
        lost = self.signal_unmeasured(name, tuple(bodies))
        if name == "edge_margin" and len(bodies) == 1 and self.bearers_unseen:
            nothing = np.isneginf(found.upper)  # nothing that is seen bears it
            lost = nothing if lost is None else lost | nothing
        if lost is None:
            return found
        return hidden(found, lost, f"{name}({', '.join(bodies)}) was not measured at every frame")

    def signal_unmeasured(self, name: str, bodies: tuple[str, ...]) -> Bool | None:
        """(T,) where something that a signal of the support graph rests on was not measured.

        None if nowhere. Of poses and forces, what was read so far counts.
        """
        gaps = self.signals.gaps
        lost = gaps.of_bodies(b for body in bodies for b in self.signals.bodies(body))
        alone = (
            name == "edge_margin" and len(bodies) == 1 and not self.blind
        )  # it sees to poses itself
        elsewhere = None if name == "overlap_xy" else unmeasured.lost_between(self, None, None)
        for more in (None if alone else unmeasured.lost_poses(self), elsewhere):
            if more is not None:
                lost = more if lost is None else lost | more
        return lost

    def measure(
        self, name: str, at: NDArray[np.int64], bodies: Sequence[str], options: Options = ()
    ) -> Series:
        """(N,) one of ``MEASURES`` at N frames."""
        found, unseen = MEASURES[name](self, at, *bodies, **dict(options)), self.episode.unseen
        return found if unseen is None else hide(found, unseen[at])

    def _slip(self, name: str, reference: Reference | None) -> Series:
        """What is held because it goes along with the gripper cannot slip, so it does not tell."""
        told = self._fingers_seen or not self.blind
        found = slip(self.episode, name, self.get("held", [name]) if told else None, reference)
        return replace(found, notes=(*found.notes, *(self.caveat("held") if told else ())))

    def between_frames(self, name: str, bodies: Sequence[str], frame: int) -> float | None:
        """As in ``Signals``."""
        return self.signals.between_frames(name, bodies, frame)

    def may_touch_between(self, a: str, b: str, where: Bool) -> Bool:
        """(T,) where two may have touched after a sample of ``where`` and before the next one."""
        return between.may_touch_between(self, a, b, where)

    def decide(
        self,
        name: str,
        bodies: list[str],
        graph: SupportGraph | None = None,
        held: Callable[[int], Bool] | None = None,
    ) -> Bool | None:
        """(T,) by the given support graph and grip; by ``self.graph`` and ``self.held`` if None."""
        index, graph, held = self.episode.body_index, graph or self.graph, held or self.held
        if name == "inside":
            body, container = bodies
            return self.inside(body, container, self._may_bear(container, body, graph))
        if name == "exposed_to":
            first, second = ([index[b] for b in self.signals.bodies(body)] for body in bodies)
            return self.exposure.exposed(first, second)
        ids = [index[body] for body in bodies]
        if name == "caused":
            return np.asarray(np.arange(len(self.episode)) >= self.causes.since(ids[0]))
        if name == "supports":
            return graph.supports(*ids)
        if name == "supported":
            return graph.supported(ids[0])
        if name == "carried":
            found = graph.carried(ids[0], held)
            if self.blind:  # friction lifts what fingers squeeze, and no shape shows it
                found = found | (held(ids[0]) & ~self._borne(ids[0]))
            return found
        if name == "held":
            return held(ids[0])
        if name == "depends_on":
            return graph.rests_on(ids[0], ids[1], held)
        raise KeyError(name)

    @cached_property
    def _hand(self) -> str | None:
        return gripper_frame(self.episode)

    @cached_property
    def _fingers_seen(self) -> bool:
        """Shapes of both fingers are known."""
        seen = {body.finger for body in self.episode.header.bodies if body.geoms}
        return {"left", "right"} <= seen

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
        if not self.blind or (self._fingers_seen and shaped):
            if self.blind:
                return by_fingers(self.episode, body, self.proximity)
            found = by_pressure(self.episode, body, self.touches.beside(body))
            return Grip(found, found, found)
        if self._hand is None or not self.episode.header.bodies[body].movable:
            nothing = np.zeros(len(self.episode), np.bool_)
            return Grip(nothing, nothing, nothing)
        return by_motion(self.episode, body, self._hand, self._borne(body))

    def _borne(self, body: int) -> Bool:
        """(T,) some body other than the robot bears it."""
        nothing = np.zeros(len(self.episode), np.bool_)
        bearers = self.graph.bearers(body).values()
        return np.asarray(np.logical_or.reduce([nothing, *bearers]))

    def _may_bear(self, bearer: str, borne: str, graph: SupportGraph) -> Bool:
        """(T,) false only where the first body does not bear the second."""
        if self.lacking("supports", (bearer, borne)):
            return np.ones(len(self.episode), np.bool_)
        index = self.episode.body_index
        return graph.supports(index[bearer], index[borne])

    def inside(self, a: str, container: str, bears: Bool) -> Bool | None:
        """(T,) lowest point under the rim and within, and (centroid within, or borne by it).

        Without a declared cavity nothing is inside: false, not unknown.
        """
        episode, movers = self.episode, self.signals.movers
        cavity = episode.bodies[container].cavity
        if cavity is None:
            return np.zeros(len(episode), np.bool_)
        if not movers.of([a]):
            return None
        low, centroid = inside_parts(movers[a], movers[container], cavity)
        return np.broadcast_to(low & (centroid | bears), len(episode))

    def _load_share(self, a: str, s: str) -> Series:
        """(T,) share of the upward load on a that s carries."""
        index = self.episode.body_index
        if not self.blind:
            return self.loads.share(index[a], index[s])
        if self.lacking("supports", (s, a)):
            return unknown(len(self.episode), "ratio", "the trace has no contact forces")
        bearers = self.graph.bearers(index[a])
        mine = bearers.get(index[s], np.zeros(len(self.episode), np.bool_))
        others = [bears for body, bears in bearers.items() if body != index[s]]
        held_ = self.may_be_held(index[a]) | self.graph.borne_by_robot(index[a])
        shared = np.logical_or.reduce([held_, *others])
        lower, upper = np.where(mine & ~shared, 1.0, 0.0), np.where(mine, 1.0, 0.0)
        return Series(lower, upper, "ratio", self.caveat("supports"))
