"""All relations of one episode, and the signals that need relations or the support graph."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import NDArray

from safestage_eval.evidence.declare import RELATIONS, SIGNALS, Options
from safestage_eval.evidence.intervals import Interval, hidden, hide
from safestage_eval.evidence.measure import Partial, Signals
from safestage_eval.evidence.missing_values import either
from safestage_eval.evidence.reference import Reference
from safestage_eval.geometry.cavity import inside_parts
from safestage_eval.geometry.pose import angle

from . import between
from .exposure import NEVER, Exposure
from .inferred import STAYS, Inferred, inferred
from .near import NEAR
from .support_facts import Support
from .worlds import World, recorded

Bool = NDArray[np.bool_]

LIES_STILL = 0.1
"""s. What stayed for so long does not begin to move by itself."""

SHIFTS, TURNS = 0.005, 0.0873
"""m and rad, as ``brief_move`` and ``brief_turn``: what moves by more was moved by something."""

GRIPS = ("held", "carried", "leaned_on")
WORDS = {
    "supports": "whether {} bears {}, or that hangs from the hand",
    "supported": "whether {} hangs from the hand",
    "carried": "when {} is grasped and let go",
    "held": "when {} is grasped and let go",
    "depends_on": "whether {} needs {}, still rests on it, or is held",
    "inside": "whether {1} bears {0}",
    "leaned_on": "whether the robot presses on {}",
}
"""What is not known of a relation without contact forces."""

BY_SHAPE = "by geometry: within 1 mm, and a lift by 5 mm opens the gap"
BY_TOUCH = "by geometry: a touch is a distance of at most 1 mm"
BY_REST = (
    "by what rests on what: needless supports count; what touches from the side may lean or not"
)


class Relations(Support):
    """Relations of an episode by name and bodies."""

    def __init__(self, signals: Signals) -> None:
        """Share the signals' contact sums and shapes."""
        super().__init__(signals)
        signals.untouched = self._untouched
        self._told: dict[tuple[str, ...], Interval] = {}
        self._exposures: dict[tuple[World, bool], Exposure] = {}
        self._asked: set[int] = set()

    # ---- the two worlds

    @cached_property
    def most(self) -> World:
        """All touches, loads and grips that may be."""
        return inferred(self) if self.blind else recorded(self)

    @property
    def least(self) -> World:
        """Those that there certainly are; the same world where nothing is left open."""
        return self.most.other

    def ends(self, decide: Callable[[World], Bool]) -> Interval:
        """What lies between a truth (T,) in the least world and that in the greatest."""
        lower = decide(self.least).astype(np.float64)
        if self.least is self.most:
            return Interval(lower, lower)
        upper = decide(self.most).astype(np.float64)
        return Interval(lower, lower if np.array_equal(lower, upper) else upper)

    def unknown(self, why: str) -> Interval:
        """Nothing is known of a relation, and why."""
        frames = len(self.episode)
        return Interval(np.zeros(frames), np.ones(frames), "number", (why,))

    def ids(self, *names: str) -> list[int]:
        """Indices of bodies."""
        return [self.episode.body_index[name] for name in names]

    # ---- relations

    def told(self, name: str, bodies: Sequence[str], wanted: Bool | None = None) -> Interval:
        """(T,) 1 where a relation holds, 0 where it does not, from 0 to 1 where the trace does not tell.

        A costly one is found out at the ``wanted`` frames (T,) alone; all of them if None. Its notes
        say how it was decided without forces, and last why it is open where it is.
        Raises KeyError for a name or body that does not exist.
        """
        key = (name, *bodies)
        if key in self._told:
            return self._told[key]
        sparse = wanted is not None and RELATIONS[name].costly and not self.blind
        decide = RELATIONS[name].decide
        found = decide(self, *bodies, wanted) if sparse else decide(self, *bodies)
        unseen = self.signals.gaps.unseen
        if unseen is not None:
            found = replace(
                found,
                lower=np.where(unseen, 0.0, found.lower),
                upper=np.where(unseen, 1.0, found.upper),
            )
        notes = dict.fromkeys((*self.caveat(name), *found.notes))
        if not sparse and not found.notes and (found.lower < found.upper).any():
            notes[self._why_open(name, bodies)] = None
        found = replace(found, notes=tuple(notes))
        if not sparse:
            self._told[key] = found
        return found

    def caveat(self, name: str) -> tuple[str, ...]:
        """How a relation is decided where it needs forces and there are none: a note, or nothing."""
        if not self.blind or "touch" not in RELATIONS[name].needs:
            return ()
        how = {"supports": BY_SHAPE, "supported": BY_SHAPE, "carried": BY_SHAPE}.get(name, BY_TOUCH)
        how = BY_REST if name == "depends_on" else how
        if name == "held":
            seen = "by the shapes of both fingers", "by what goes along with the gripper"
            how = seen[not self.fingers_seen]
        return (f"without contact forces {name}() is decided {how}",)

    def _why_open(self, name: str, bodies: Sequence[str]) -> str:
        """Why a relation is not known at every frame; what is missing comes first."""
        touched = f"it is not known whether the robot, or what it moved, touched {bodies[0]}"
        why = [self._why_lost(name, bodies)] if self._lost(bodies) else []
        if name in GRIPS and self.lacks_hand():
            why.append(f"the trace has no {self.lacks_hand()}")
        if self.blind:
            shapes = self.signals.movers.unseen([b for x in bodies for b in self.signals.bodies(x)])
            if shapes:
                why.append(f"the trace has no contact forces and no shape of {', '.join(shapes)}")
            elif name == "leaned_on" and self.lacks_shapes_of_robot():
                why.append(f"the trace has no {self.lacks_shapes_of_robot()}")
            elif name in WORDS and not why:
                words = WORDS[name].format(*bodies)
                why.append(f"without contact forces it is not known {words}")
        elif name in ("supports", "supported", "carried", "inside", "leaned_on"):
            if self.unweighed:
                masses = ", ".join(self.unweighed)
                why.append(f"the trace has no mass of {masses}: what bears it is not known")
            elif self.faint:
                light = ", ".join(self.faint)
                why.append(f"what bears {light} is less than the rounding of the recorded forces")
        elif name == "depends_on" and not why:
            why.append(
                f"whether {bodies[0]} falls without {bodies[1]} hangs on what is within "
                f"{NEAR * 1e3:g} mm and carries nothing yet"
            )
        if name in ("caused", "may_be_caused"):
            why.append(touched)
        return "; ".join(why) or f"{name}({', '.join(bodies)}) is not known at every frame"

    def _lost(self, bodies: Sequence[str]) -> bool:
        """Some force, or the pose of one of the bodies, was not measured."""
        gaps = self.signals.gaps
        poses = gaps.of_bodies([b for body in bodies for b in self.signals.bodies(body)])
        return poses is not None or (not self.blind and gaps.of_contacts)

    def _why_lost(self, name: str, bodies: Sequence[str]) -> str:
        """Why something is not known at every frame: a touch that was not recorded, or a gap."""
        said, index = self.signals.gaps.unrecorded, self.episode.body_index
        for body in (*(index[b] for b in bodies if b in index), *said):
            if body in said:
                return said[body]
        return f"{name}({', '.join(bodies)}) was not measured at every frame"

    def where_measured(self, found: Interval, bodies: Sequence[str]) -> Interval:
        """A relation, open where the pose of one of the bodies was not measured."""
        lost = self.signals.gaps.of_bodies(bodies)
        if lost is None:
            return found
        lower, upper = np.where(lost, 0.0, found.lower), np.where(lost, 1.0, found.upper)
        return replace(found, lower=lower, upper=upper)

    def in_cavity(self, name: str, container: str) -> tuple[Bool, Bool] | str:
        """(T,) a body's lowest point is in a cavity; and its centroid. Or what is missing to tell."""
        frames, movers, vessel = (
            len(self.episode),
            self.signals.movers,
            self.episode.bodies[container],
        )
        if "cavity" in vessel.untold:
            return f"inside of {container}"
        if vessel.cavity is None:
            nowhere = np.zeros(frames, np.bool_)
            return nowhere, nowhere
        if not movers.of([name]):
            return f"shape of {name}"
        low, centroid = inside_parts(movers[name], movers[container], vessel.cavity)
        return np.broadcast_to(low, frames), np.broadcast_to(centroid, frames)

    def falls_without(self, body: str, on: str, wanted: Bool | None) -> Interval:
        """(T,) whether ``body`` falls when ``on`` is taken away, at least at the ``wanted`` frames."""
        first, second = self.ids(body, on)
        if self.blind:
            return self.ends(lambda world: cast(Inferred, world).hangs_on(first, second))
        masses = self.lacks_masses(on)
        if masses:
            return self.unknown(f"the trace has no {masses}".replace(", mass of ", ", "))
        falls, open_ = self.dependence.depends_on(first, second, wanted)
        if wanted is not None:
            open_ = open_ | ~(wanted | self.dependence.answered(first, second))
        lost = self.lost_about((body, on))
        open_ = open_ if lost is None else open_ | lost
        lower = falls.astype(np.float64)
        if not open_.any():
            return Interval(lower, lower)
        return Interval(np.where(open_, 0.0, lower), np.where(open_, 1.0, lower))

    # ---- what the robot had to do with

    def exposure(self, world: World, *, moves: bool = False) -> Exposure:
        """Who has touched whom in a world, directly or not."""
        if (world, moves) not in self._exposures:
            self._exposures[world, moves] = Exposure(world, moves=moves)
        return self._exposures[world, moves]

    @cached_property
    def robot(self) -> set[int]:
        """Indices of the robot's moving bodies, and of what is jointed to them."""
        assemblies = self.graph.assemblies
        on = {i for i in range(len(self.episode.header.bodies)) if assemblies.on_robot(i)}
        return assemblies.robot | on if assemblies.robot else set()

    def reached(self, world: World, body: int) -> int:
        """Frame from which the robot has had to do with a body; ``NEVER`` if it had not."""
        self._asked.add(body)
        links = any("links" in it.untold for it in self.episode.header.bodies)
        if world.most and not world.complete and links:
            return 0  # where the rest of the arm was is not recorded
        return self.exposure(world, moves=True).since((body,), self.robot)

    def _untouched(self, name: str) -> int:
        """Up to which frame the robot has certainly had nothing to do with a body."""
        if not self.robot:
            return len(self.episode)
        return self.reached(self.most, self.episode.body_index[name])

    def has_lain_still(self, name: str) -> Bool:
        """(T,) it has lain still before, so that it does not begin to move by itself.

        Not where something that was not recorded is known to have moved it.
        """
        episode, track = self.episode, self.episode.track(name)
        t = episode.t
        ago = np.maximum(np.searchsorted(t, t - LIES_STILL - 1e-9), 0)
        still = np.linalg.norm(track.position - track.position[ago], axis=1) <= STAYS[0]
        still &= angle(track.orientation, track.orientation[ago]) <= STAYS[1]
        rested = np.maximum.accumulate(still & (t >= t[0] + LIES_STILL))
        if len(episode.tracks[name]) == 1:
            rested[:] = True
        if self.signals.gaps.unrecorded:
            caused = self.told("caused", (name,))
            rested &= caused.lower == caused.upper
        return rested

    @property
    def chained(self) -> bool:
        """Answers so far hang on contacts between any bodies: that some did not touch is one of them.

        Who was exposed to whom, and who moved though the robot had nothing to do with it.
        """
        if self.blind:
            return False
        if any(not moves for _, moves in self._exposures):
            return True
        for body in self._asked:
            it = self.episode.header.bodies[body]
            if it.movable and self.robot and self.reached(self.least, body) == NEVER:
                track = self.episode.track(it.name)
                if self.signals.gaps.of_bodies([it.name]) is not None:
                    return True
                if np.ptp(track.position, axis=0).max() > SHIFTS:
                    return True
                if angle(track.orientation, track.orientation[0]).max() > TURNS:
                    return True
        return False

    def may_touch_between(self, a: str, b: str, where: Bool) -> Bool:
        """(T,) where two may have touched after a sample of ``where`` and before the next one."""
        return between.may_touch_between(self, a, b, where)

    def between_frames(self, name: str, bodies: Sequence[str], frame: int) -> float | None:
        """M by which a distance may differ between two frames; see ``Signals.between_frames``."""
        return self.signals.between_frames(name, bodies, frame)

    def bearers(self, body: str, frame: int) -> tuple[str, ...]:
        """Names of the bodies that bear one directly at a frame."""
        known = self.graph.bearers(self.episode.body_index[body])
        names = [b.name for b in self.episode.header.bodies]
        return tuple(names[b] for b, on in sorted(known.items()) if on[frame])

    # ---- signals

    def signal(
        self,
        name: str,
        bodies: Sequence[str],
        reference: Reference | None = None,
        reach: float = 0,
        wanted: Bool | None = None,
        options: Options = (),
        limits: Sequence[float] = (),
    ) -> Interval:
        """Any signal: those of ``signals``, and those that need the support graph.

        The costly ones are measured at the ``wanted`` frames (T,) only, and are unknown at the
        others; every frame is measured at most once. ``limits``: as in ``Signals.get``.
        """
        signal, bodies, known = SIGNALS[name], tuple(bodies), self.signals.known
        key = ("of relations", name, bodies, reference.key if reference else "", options)
        if name == "peak_force":
            if key not in known:
                recorded = self.signals.get(name, bodies, options=options)
                known[key] = between.with_missed_peaks(self, bodies, recorded)
            found: Interval = known[key]
            return found
        if not signal.support:
            return self.signals.get(name, bodies, reference, reach, options, limits)
        if not signal.costly:
            if key not in known:
                ask = self.signals.request(name, bodies, reference, options=options, relations=self)
                known[key] = signal.measure(ask)
            return self._known_part(name, bodies, known[key])
        wanted = np.ones(len(self.episode), np.bool_) if wanted is None else wanted
        partial: Partial = known.setdefault(key, Partial.blank(len(self.episode)))
        at = partial.missing(wanted)
        if len(at):
            ask = self.signals.request(name, bodies, None, 0, False, 0, options, self, at)
            series, unseen = signal.measure(ask), self.episode.unseen
            partial.add(at, series if unseen is None else hide(series, unseen[at]))
        return self._known_part(name, bodies, partial.series(wanted, signal.dimension))

    def _known_part(self, name: str, bodies: tuple[str, ...], series: Interval) -> Interval:
        """Make a signal unknown where something that it may rest on was not measured."""
        lost = self.signals.gaps.of_bodies(b for body in bodies for b in self.signals.bodies(body))
        if name not in (
            "overlap_xy",
            "fall",
            "moved_by",
            "tipped_by",
        ):  # which see to it themselves
            lost = either(lost, self.lost_about(bodies))
        if name == "edge_margin" and len(bodies) == 1 and self.blind:
            shapeless = (b.name for b in self.episode.header.bodies if b.kind != "robot")
            if self.signals.movers.unseen([*shapeless]):
                lost = either(lost, np.isneginf(series.upper))  # nothing that is seen bears it
        if lost is None:
            return series
        return hidden(series, lost, self._why_lost(name, bodies))

    def lost_about(self, names: Sequence[str]) -> Bool | None:
        """(T,) where a force on one of the bodies is not known, or on what hangs together with it by touch.

        Or where such a body is. Touches that may be count; the robot and what stands fixed pass nothing on.
        """
        gaps, sums, bodies = (
            self.signals.gaps,
            self.signals.contact_sums,
            self.episode.header.bodies,
        )
        away = {
            i: gone
            for i, body in enumerate(bodies)
            if body.movable and (gone := gaps.of_body(body.name)) is not None
        }
        # to ask for a world reads the contacts, and so finds their gaps
        if not away and (self.blind or (self.least and not gaps.of_contacts)):
            return gaps.unseen
        assemblies, always = self.graph.assemblies, np.ones(len(self.episode), np.bool_)
        ends = assemblies.fixed | assemblies.robot
        named = set(self.ids(*(b for name in names for b in self.signals.bodies(name))))
        reached = dict.fromkeys(named - ends, always)
        todo = [*reached]
        while todo:
            body = todo.pop()
            parts = assemblies.of(body)
            for other in (parts | {*self.most.beside(body)}) - ends - {body}:
                joined = always if other in parts else self.most.near(body, other)
                before = reached.get(other, ~always)
                if (gained := joined & reached[body] & ~before).any():
                    reached[other] = before | gained
                    todo.append(other)
        lost = [reached[body] & away[body] for body in reached.keys() & away.keys()]
        if not self.blind:
            lost += [
                reached[body] & known
                for body in reached
                for other in sums.beside(body)
                if (known := sums.unknown(body, other)) is not None
            ]
        return either(gaps.unseen, *lost)
