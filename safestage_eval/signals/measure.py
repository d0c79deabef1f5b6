"""All signals of one episode, each measured once, when it is first asked for."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from safestage_eval.episode import Episode
from safestage_eval.geometry.cavity import containment_depth
from safestage_eval.geometry.clearance import clearance_series, motion_bound
from safestage_eval.geometry.footprint import clearance_xy

from . import distance, motion
from .contact_sums import ContactSums
from .distance import Movers
from .reference import Baseline, Reference
from .series import Series, exact, unknown
from .vocabulary import SIGNALS

CAP = 0.10
"""m: a clearance series is exact up to here; beyond, it says only "more than that"."""

CAPPED = ("clearance", "clearance_xy")

_MEASURED_SINCE = {"height", "lift", "displacement", "displacement_xy", "turn"}


class Signals:
    """Signals of an episode by name and bodies, in SI, each a ``Series`` over all frames."""

    def __init__(self, episode: Episode, baseline_frames: int = 5) -> None:
        """``baseline_frames``: how many first frames estimate the initial state."""
        self.episode = episode
        self.baseline = Baseline(baseline_frames)
        self.movers = Movers(episode)
        self._known: dict[tuple[str, tuple[str, ...], str, float], Series] = {}

    @cached_property
    def contact_sums(self) -> ContactSums:
        """Forces summed per pair of bodies."""
        return ContactSums(self.episode)

    def bodies(self, name: str) -> list[str]:
        """The bodies a name stands for: itself, or those of the union ``robot`` or ``gripper``.

        An immobile base of the robot is a fixture and in no union.
        """
        if name in self.episode.bodies:
            return [name]
        kinds = {"robot": ("robot", "gripper"), "gripper": ("gripper",)}[name]
        return [
            body.name for body in self.episode.header.bodies if body.kind in kinds and body.movable
        ]

    def get(
        self,
        name: str,
        bodies: Sequence[str] = (),
        reference: Reference | None = None,
        reach: float = CAP,
    ) -> Series:
        """One signal.

        Args:
            name: as in ``vocabulary.SIGNALS``.
            bodies: names of bodies or unions, in the signal's order.
            reference: for signals that measure a change; the baseline if None.
            reach: m, for clearances: distances up to here are wanted exactly.

        Raises KeyError for a name or body that does not exist.
        """
        cap = max(reach, CAP) if name in CAPPED else 0.0
        key = (name, tuple(bodies), reference.key if reference else "", cap)
        if key not in self._known:
            self._known[key] = self._measure(name, list(bodies), reference, cap)
        return self._known[key]

    def between_frames(self, name: str, bodies: Sequence[str], frame: int) -> float | None:
        """How much further (m) the value may have gone between the frame and its neighbours.

        Half the bound on the relative motion over one recorded step: for distances only, None for
        other signals.
        """
        if name not in CAPPED:
            return None
        first, second = (self.movers.of(self.bodies(body)) for body in bodies)
        steps = slice(max(frame - 1, 0), frame + 1)
        bounds = [motion_bound(a, b)[steps].max(initial=0.0) for a in first for b in second]
        return float(max(bounds, default=0.0)) / 2

    def _measure(
        self, name: str, bodies: list[str], reference: Reference | None, cap: float
    ) -> Series:
        spec, frames = SIGNALS[name], len(self.episode)
        groups = [self.bodies(body) for body in bodies]
        if any(not group for group in groups):
            return unknown(frames, spec.dimension, f"the trace has no {' or '.join(bodies)}")
        if "forces" in spec.needs:
            return self._force(name, groups)
        if "geometry" in spec.needs:
            return self._distance(name, groups, reference, cap)
        if name == "gripper_opening":
            opening = self.episode.frames.gripper
            if not opening.shape[1]:
                return unknown(frames, spec.dimension, "the trace has no gripper opening")
            return exact(opening[:, 0], spec.dimension)
        if name == "tilt":
            tilt = motion.tilt(self.episode, bodies[0])
            if tilt is None:  # below every upper limit and above no lower one: skipped
                note = f"{bodies[0]} has no up axis: its tilt is not judged"
                return exact(np.full(frames, -np.inf), spec.dimension, (note,))
            return exact(tilt, spec.dimension)
        if name in _MEASURED_SINCE:
            return exact(self._change(name, bodies[0], reference), spec.dimension)
        if name == "relative_speed":
            value = motion.relative_speed(self.episode, groups[0], groups[1])
        else:
            value = {
                "speed": motion.speed,
                "vertical_speed": motion.vertical_speed,
                "angular_speed": motion.angular_speed,
            }[name](self.episode, bodies[0])
        return exact(value, spec.dimension)

    def _change(self, name: str, body: str, reference: Reference | None) -> motion.F64:
        since = reference or Reference(self.baseline)
        if name == "height":
            return motion.height(self.episode, body, reference)
        if name == "turn":
            return motion.turn(self.episode, body, since)
        return motion.displacement(self.episode, body, since, 2 if name.endswith("xy") else 3)

    def _force(self, name: str, groups: list[list[str]]) -> Series:
        frames = len(self.episode)
        if self.episode.header.force_source == "none":
            return unknown(frames, "force", "the trace has no contact forces")
        index, sums = self.episode.body_index, self.contact_sums
        first = {index[body] for body in groups[0]}
        second = {index[b] for b in groups[1]} if len(groups) > 1 else set(index.values()) - first
        total = np.zeros(frames)
        for i, j in sums.pairs:
            if (i in first and j in second) or (j in first and i in second):
                total = total + (sums.peak(i, j) if name == "peak_force" else sums.normal(i, j))
        return exact(total, "force")

    def _distance(
        self, name: str, groups: list[list[str]], reference: Reference | None, cap: float
    ) -> Series:
        spec, frames = SIGNALS[name], len(self.episode)
        movers = [self.movers.of(group) for group in groups]
        bare = [" and ".join(g) for g, m in zip(groups, movers, strict=True) if not m]
        if bare:
            return unknown(frames, spec.dimension, f"the trace has no shape of {', '.join(bare)}")
        if name in CAPPED:
            measured = clearance_series if name == "clearance" else clearance_xy
            found = measured(movers[0], movers[1], cap)
            lower, upper = (np.broadcast_to(x, frames) for x in (found.lower, found.upper))
            return Series(lower, upper, spec.dimension)
        if name == "lift":
            value = distance.lift(movers[0][0], frames, reference or Reference(self.baseline))
        elif name == "height_above":
            value = distance.height_above(movers[0], movers[1], frames)
        elif name == "containment_depth":
            cavity = self.episode.bodies[groups[1][0]].cavity
            if cavity is None:
                return unknown(frames, spec.dimension, f"{groups[1][0]} has no declared cavity")
            value = containment_depth(movers[0][0], movers[1][0], cavity)
        else:
            raise KeyError(name)
        return exact(np.broadcast_to(value, frames), spec.dimension)
