"""Contradictions within a trace: every check of that kind, over one episode.

A file may be well formed, its digests right, and still say centimetres for metres. What the trace
itself shows to be wrong is found here by comparing what it says twice: velocities with poses,
contacts with poses and shapes, forces with weights. What nobody could see is not: all lengths, say,
in another unit together with gravity.

Nothing is read for it. ``AtHand`` gives the columns that were read for a verdict, so that what a
verdict rests on is checked at hardly any cost; ``Whole`` gives everything (``safestage audit``).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from operator import is_
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from . import body_invariants as bodies
from . import contact_invariants as touch
from . import motion_invariants as motion
from .body import Body
from .column_comparisons import add_forces
from .contacts import Pair
from .contradiction import ContradictionError
from .episode import Episode
from .frames import RobotFrames
from .mesh import Mesh
from .rounding import Rounding, rounding_of
from .scene_shapes import BodyShapes, body_shapes

Array = NDArray[Any]

PAIRS = (("position", "linear_velocity"), ("orientation", "angular_velocity"))
"""Poses, and velocities that say how they change."""


CONTACTS = ("frame", "position", "normal", "force", "force.z", "peak_force", "depth")
"""Columns of contacts that are looked at."""


class AtHand(Protocol):
    """Columns that may be looked at."""

    def matters(self, body: str) -> bool:
        """Whether contacts and forces of a body are to be looked at."""

    def some(self, body: str) -> bool:
        """Whether any column of a body's track is at hand."""

    def track(self, body: str, column: str) -> Array | None:
        """A column as in ``Track``; None where it is not at hand.

        The place of a fixture is one row, and may be read; that of a free body where it matters.
        """

    def contacts(self, pair: Pair, *read: str) -> Mapping[str, Array]:
        """Columns of the contacts of a pair, as ``ContactTable.of_pair``, by name.

        ``read``: columns that are to be read if they are not at hand.
        """

    def frames(self) -> RobotFrames | None:
        """Joints and gripper; None where they are not at hand."""

    def meshes(self) -> Mapping[str, Mesh]:
        """Those at hand."""


class Whole:
    """Everything is at hand."""

    def __init__(self, episode: Episode) -> None:
        self._episode = episode

    def matters(self, body: str) -> bool:
        """See ``AtHand``."""
        return body in self._episode.tracks

    def some(self, body: str) -> bool:
        """See ``AtHand``."""
        return body in self._episode.tracks

    def track(self, body: str, column: str) -> Array | None:
        """See ``AtHand``."""
        found: Array = getattr(self._episode.tracks[body], column)
        return found

    def contacts(self, pair: Pair, *_: str) -> Mapping[str, Array]:
        """See ``AtHand``."""
        return dict(zip(CONTACTS, self._episode.contacts.of_pair(pair, *CONTACTS), strict=True))

    def frames(self) -> RobotFrames | None:
        """See ``AtHand``."""
        return self._episode.frames

    def meshes(self) -> Mapping[str, Mesh]:
        """See ``AtHand``."""
        return self._episode.meshes


def contradictions(episode: Episode, at_hand: AtHand | None = None) -> Iterator[ContradictionError]:
    """Everything that cannot be true, of a sound file; ``at_hand``: what may be read, None: all."""
    looked = _Looked(episode, Whole(episode) if at_hand is None else at_hand)
    yield from looked.header()
    yield from looked.motion()
    yield from looked.contacts()
    yield from looked.weights()
    yield from looked.joints()


_SOUND: list[tuple[tuple[Body, ...], int]] = []
"""Bodies of scenes that were met lately and found sound, and how many meshes were at hand."""


class _Looked:
    """One episode, as far as it is at hand."""

    def __init__(self, episode: Episode, at_hand: AtHand) -> None:
        self.episode, self.at_hand = episode, at_hand
        self.where = str(episode.path or episode.header.episode_id)
        self.meshes = at_hand.meshes()
        self._roundings: dict[str, Rounding] = {}
        matters = [at_hand.matters(body.name) for body in episode.header.bodies]
        self.pairs = {
            (i, j): at_hand.contacts((i, j))
            for i, j in episode.contacts.pairs
            if matters[i] or matters[j]
        }

    def rounding(self, column: str) -> Rounding:
        """That of a column of contacts, as far as it is at hand."""
        if column not in self._roundings:
            parts = [told[column].ravel() for told in self.pairs.values() if column in told]
            self._roundings[column] = rounding_of(np.concatenate([*parts, np.zeros(0, np.float32)]))
        return self._roundings[column]

    def shapes(self, body: Body) -> BodyShapes | None:
        return body_shapes(body, self.meshes)

    def header(self) -> Iterator[ContradictionError]:
        """Time steps, gravity, endings, names; masses and shapes of scenes not met before."""
        header, where = self.episode.header, self.where
        for found in (
            bodies.check_steps_of_time(header, where),
            bodies.check_gravity(header, where),
            bodies.check_ending(header, where),
            bodies.check_names(header, where),
        ):
            yield from found
        for known, meshes in _SOUND:  # the scenes of a task share their bodies
            same = len(known) == len(header.bodies) and all(map(is_, known, header.bodies))
            if same and meshes == len(self.meshes):
                return
        found = []
        for body in header.bodies:
            found += bodies.check_tool(body, where)
            shapes = self.shapes(body) if body.kind == "object" else None
            if shapes is not None:
                found += bodies.check_mass(body, shapes, where)
                found += bodies.check_inertia(body, shapes, where)
                found += bodies.check_cavity(body, shapes, where)
        yield from found
        if not found:
            _SOUND[:] = [(header.bodies, len(self.meshes)), *_SOUND[:7]]

    def motion(self) -> Iterator[ContradictionError]:
        """Poses against velocities, and against the floor."""
        t, where, unseen = self.episode.t, self.where, self.episode.unseen
        some = [body for body in self.episode.header.bodies if self.at_hand.some(body.name)]
        floors = []
        for body in some:
            if not body.movable and any(geom.kind == "plane" for geom in body.geoms):
                turn, place = (self.at_hand.track(body.name, c) for c in reversed(motion.WORDS))
                if place is not None and turn is not None and abs(turn[0, 0]) > 0.999:
                    floors.append((body.name, place))
        for body in some:
            if not body.movable:
                continue
            place = self.at_hand.track(body.name, "position")
            for column, speed in PAIRS:
                pose, rate = (self.at_hand.track(body.name, c) for c in (column, speed))
                if pose is not None and rate is not None:
                    yield from motion.check_velocities(
                        t, pose, rate, column, body.name, where, unseen
                    )
                elif column == "position" and pose is not None:
                    yield from motion.check_steps(t, pose, body.name, where, unseen)
            shapes = self.shapes(body) if place is not None and floors else None
            if place is not None and shapes is not None:
                for name, floor in floors:
                    yield from motion.check_above_floor(
                        place, floor, shapes.radius, body.name, name, t, where
                    )

    def contacts(self) -> Iterator[ContradictionError]:
        """Contacts against poses and shapes, and within themselves."""
        header, t, where, get = self.episode.header, self.episode.t, self.where, self.at_hand
        for pair, told in self.pairs.items():
            frame, point = told.get("frame"), told.get("position")
            names = first, second = header.bodies[pair[0]].name, header.bodies[pair[1]].name
            there = []
            for body in sorted((header.bodies[i] for i in pair), key=lambda b: not b.movable):
                shapes, place = self.shapes(body), get.track(body.name, "position")
                if shapes is None or place is None:
                    break
                turn = get.track(body.name, "orientation")
                there.append((shapes.radius, body.name, place, turn, shapes))
                if frame is not None and point is not None and turn is not None:
                    yield from touch.check_contact_points(
                        frame, point, place, turn, shapes, (body.name, first, second), t, where
                    )
            if len(there) == 2:
                small, large = sorted(there, key=lambda one: one[0])
                if frame is not None and large[3] is not None:
                    yield from touch.check_reached_body(
                        frame, small[2], small[0], large[2], large[3], large[4],
                        (small[1], large[1]), t, where,
                    )  # fmt: skip
                else:
                    yield from touch.check_touching_bodies(
                        frame, small[2], large[2], small[0] + large[0], names, t, where
                    )
            if frame is None:
                continue
            if "depth" in told:
                yield from touch.check_depths(told["depth"], names, where)
            if told.keys() >= {"peak_force", "force", "normal"}:
                yield from touch.check_peaks(
                    frame, told["force"], told["normal"], told["peak_force"], names, where,
                    self.rounding,
                )  # fmt: skip

    def weights(self) -> Iterator[ContradictionError]:
        """Forces against the weights of free bodies at rest."""
        header = self.episode.header
        every = dict.fromkeys((*self.pairs, *self.episode.contacts.pairs))
        told = (self.pairs.get(p) or self.at_hand.contacts(p) for p in every)
        forces = (found[c] for found in told for c in ("force", "force.z") if c in found)
        if header.force_source in ("normal", "none") or not any(force.any() for force in forces):
            return  # friction bears as well; zero throughout: not recorded
        for i in _free(header.bodies, (joint.body for joint in header.joints)):
            body = header.bodies[i]
            place = self.at_hand.track(body.name, "position")
            if place is None or not self.at_hand.matters(body.name):
                continue
            found = self._borne(i, place, exact=False)
            if found:  # contacts that no rule asked for may explain it, or the frames between
                found = self._borne(i, place, exact=True)
            yield from found

    def _borne(self, i: int, place: Array, *, exact: bool) -> list[ContradictionError]:
        """Contradiction in the support of a body (index); ``exact``: all of its contacts are known."""
        t, header, body = self.episode.t, self.episode.header, self.episode.header.bodies[i]
        sums, touched = np.zeros((len(t), 4)), np.zeros(len(t), np.bool_)
        many = 0
        for pair, told in self.pairs.items():
            if i not in pair:
                continue
            if told.keys() >= {"frame", "force"}:
                sign = -1.0 if pair[0] == i else 1.0
                every = 1 if exact else touch.EVERY
                touched[told["frame"]] = True
                add_forces(told["frame"], told["force"], sign, every, sums)
                if exact and len(told["frame"]):
                    many += int(np.bincount(told["frame"]).max())
            elif exact:
                frame = self.at_hand.contacts(pair, "frame")["frame"]
                sums[frame], touched[frame] = np.nan, True
        if self.episode.unseen is not None:
            sums[self.episode.unseen], touched[self.episode.unseen] = np.nan, True
        gravity, off = -header.gravity[2], 0.0
        if many:  # at the frames at which it is pressed, but for one in ten
            share, step = self.rounding("force")
            pressed = sums[sums[:, 3] > 0, 3]
            off = np.sqrt(3) * step * many
            off += share * float(np.quantile(pressed, 0.9)) if len(pressed) else 0.0
        found = touch.check_weight(
            t,
            place,
            (body.mass or 0.0) * gravity,
            sums,
            body.name,
            self.where,
            dense=exact,
            off=off,
        )
        return found or (
            touch.check_free_fall(t, place, gravity, touched, body.name, self.where)
            if body.mass
            else []
        )

    def joints(self) -> Iterator[ContradictionError]:
        """Joints against their limits and velocities."""
        frames, header = self.at_hand.frames(), self.episode.header
        if frames is not None:
            yield from bodies.check_joint_ranges(frames, header, self.where)
            yield from bodies.check_joint_speeds(self.episode.t, frames, header, self.where)


def _free(all_bodies: tuple[Body, ...], moved: Iterable[str | None]) -> list[int]:
    """Objects that nothing is jointed to, so that contacts alone bear them."""
    jointed = {body.parent for body in all_bodies} | set(moved)
    return [
        i
        for i, body in enumerate(all_bodies)
        if body.kind == "object" and body.movable and body.geoms
        and body.parent is None and body.name not in jointed
    ]  # fmt: skip
