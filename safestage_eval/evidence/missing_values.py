"""Values of an episode that were not recorded, per frame.

Missing are: a body's pose or velocity where it is NaN or infinite; everything at the frames of
``Episode.unseen``; the force of a pair of bodies where a contact of theirs holds NaN, a normal that
is not of unit length, or a force that pulls; its peak there, and where the peak is NaN. Signals are computed from the cleaned episode, in which
the last measured value stands in a gap, and are then made unknown there (``Signals``,
``Relations``).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, ContactTable, Episode, RobotFrames, Track
from safestage_eval.episode.contacts import Pair
from safestage_eval.episode.header import SKETCH
from safestage_eval.episode.invariants import all_finite, measured
from safestage_eval.episode.lazy_columns import StoredItems, StoredTrack
from safestage_eval.geometry.pose import transform

from .unexplained_motion import Path, unexplained_motion

Bool = NDArray[np.bool_]

POSE = ("position", "orientation")
TWIST = ("linear_velocity", "angular_velocity")
STILL, SAMPLES, PLACE = 0.1, 3, 1e-4
"""s, samples and m: a free body that stays in its place so long, in gravity, is borne by something."""


class Gaps:
    """Missing values of one episode, and the episode without NaN."""

    def __init__(self, episode: Episode) -> None:
        """Nothing is read; a column is looked at when it is first loaded."""
        self.given = episode
        self.frames = len(episode)
        self._tracks: dict[str, dict[str, Bool | None]] = {}
        self._forces: dict[Pair, tuple[Bool, str]] = {}
        self._peaks: dict[Pair, tuple[Bool, str]] = {}
        self.unrecorded: dict[int, str] = {}
        """Body (index) → sentence on the touch that set it in motion and was not recorded."""
        self.asked: dict[Pair, set[str]] = {}
        """Pair → columns of its contacts that were read."""
        self.whole = True
        """Set to false for a part of an episode, which does not tell whether forces were recorded."""
        self.unseen = None if episode.unseen is None or not episode.unseen.any() else episode.unseen

    @cached_property
    def episode(self) -> Episode:
        """The episode, with the last measured value in place of NaN; columns are loaded as before."""
        given, clean = self.given, object.__new__(type(self.given))
        vars(clean).update(vars(given))
        vars(clean)["tracks"] = StoredItems(given.tracks, self._track)
        vars(clean)["_contacts"] = lambda: _CleanContacts(given.contacts, self)
        vars(clean)["_frames"] = lambda: RobotFrames(
            *(measured(getattr(given.frames, column.name)) for column in fields(RobotFrames))
        )
        vars(clean)["channels"] = StoredItems(given.channels, lambda k: measured(given.channels[k]))
        vars(clean).pop("contacts", None)
        vars(clean).pop("frames", None)
        return clean

    # ---- tracks

    def _track(self, body: str) -> Track:
        """A track of which each column is loaded and cleaned when it is first asked for."""
        given = self.given.tracks[body]
        return StoredTrack(
            lambda columns: {c: self._clean(body, c, getattr(given, c)) for c in columns}
        )

    def _clean(self, body: str, column: str, values: NDArray[np.float32]) -> NDArray[Any]:
        """A column as it is used, after noting where it was not measured."""
        lost = None if all_finite(values) else np.asarray(~np.isfinite(values).all(axis=1))
        if (
            lost is not None and lost.all() and column in TWIST
        ):  # never recorded: derived from poses
            lost, values = None, np.zeros_like(values)
        self._tracks.setdefault(body, {})[column] = lost
        return values if lost is None else filled(values, lost)

    def of_body(self, body: str, columns: Iterable[str] = POSE) -> Bool | None:
        """(T,) true where one of these columns of a body was not measured; None if nowhere."""
        known = self._tracks.setdefault(body, {})
        for column in columns:
            if column not in known:
                getattr(self.episode.tracks[body], column)
        lost = either(*(known[column] for column in columns))
        return None if lost is None else np.broadcast_to(lost, self.frames)

    def of_bodies(
        self, bodies: Iterable[str], columns: Iterable[str] = POSE, *, unseen: bool = True
    ) -> Bool | None:
        """Gaps of several bodies, and frames without any record unless ``unseen`` is false."""
        columns = tuple(columns)
        return either(
            self.unseen if unseen else None, *(self.of_body(body, columns) for body in bodies)
        )

    def knows(self, body: str, column: str | None = None) -> bool:
        """Whether a column of a body's track was looked at; or any."""
        known = self._tracks.get(body, {})
        return bool(known) if column is None else column in known

    # ---- contacts

    def mark(
        self, pair: Pair, frames: NDArray[np.integer], why: str, *, peak: bool = False
    ) -> None:
        """Note that the force between two bodies (indices), or its peak, is not known at some frames."""
        known = self._peaks if peak else self._forces
        lost, _ = known.setdefault(pair, (np.zeros(self.frames, np.bool_), why))
        lost[frames] = True

    def of_pair(self, i: int, j: int) -> Bool | None:
        """(T,) true where their force is not known, of what was read so far; None if nowhere."""
        return self.of_pairs([(i, j)])

    def of_pairs(self, pairs: Iterable[Pair], *, peaks: bool = False) -> Bool | None:
        """Gaps of several pairs, and frames without any record; ``peaks``: of their peaks as well."""
        keys = [(min(pair), max(pair)) for pair in pairs]
        found = either(self.unseen, *(self._forces[key][0] for key in keys if key in self._forces))
        return either(found, *(self._peaks[k][0] for k in keys if peaks and k in self._peaks))

    def of_peak(self, i: int, j: int) -> Bool | None:
        """(T,) true where their peak is NaN, of what was read so far; None if nowhere."""
        lost = self._peaks.get((min(i, j), max(i, j)))
        return None if lost is None else lost[0]

    @property
    def of_contacts(self) -> bool:
        """Some force or peak is known to be missing, of what was read so far."""
        return bool(self._forces or self._peaks)

    def in_doubt(self, pair: Pair, column: str) -> bool:
        """A column of the contacts of one of two bodies (indices) contradicts others."""
        bodies = self.given.header.bodies
        return any((bodies[i].name, column) in self.given.doubtful for i in pair)

    def told(self, pairs: Iterable[Pair], *, peaks: bool = False) -> tuple[str, ...]:
        """A note on each of the pairs that has such frames; ``peaks``: of their peaks as well."""
        names, found = [body.name for body in self.given.header.bodies], []
        for pair in dict.fromkeys((min(pair), max(pair)) for pair in pairs):
            for what, known in (("force", self._forces), ("peak force", self._peaks))[: 1 + peaks]:
                if pair not in known:
                    continue
                lost, why = known[pair]
                if why not in self.unrecorded.values():
                    at, many = int(lost.argmax()), int(lost.sum())
                    why = (
                        f"the {what} between {names[pair[0]]} and {names[pair[1]]} is not known in "
                        f"{many} frames from {self.given.t[at]:.3f} s on: {why}"
                    )
                found.append(why)
        return tuple(dict.fromkeys(found))

    def unexplained(self) -> dict[int, int]:
        """Body (index) → frame after which a touch that was not recorded set it in motion.

        Read past the clean episode: what a verdict rests on is not widened by it. A part of an episode,
        and one that was drawn or has no forces, tell nothing of it.
        """
        episode, contacts = self.given, self.given.contacts
        if not self.whole or episode.header.source.recorder == SKETCH or not self.forces:
            return {}
        paths = {
            i: self._path(body)
            for i, body in enumerate(episode.header.bodies)
            if body.movable
            and body.kind in ("object", "fixture")
            and len(episode.track(body.name)) > 1
        }
        found = unexplained_motion(
            episode.t, paths, contacts.pairs, lambda pair: contacts.of_pair(pair, "frame")[0],
            episode.header.bodies,
        )  # fmt: skip
        return dict(found)

    def _path(self, body: Body) -> Path:
        track = self.given.track(body.name)
        lost = np.zeros(self.frames, np.bool_) if self.unseen is None else self.unseen
        place, turn = track.position, track.orientation
        for column in (place, turn):
            if not all_finite(column):
                lost = lost | ~np.isfinite(column).all(axis=1)
        place, turn = (
            (filled(column, lost) for column in (place, turn)) if lost.any() else (place, turn)
        )
        return Path(
            transform(place, turn, np.asarray(body.com)) if any(body.com) else place, turn, lost
        )

    def mark_unexplained(self, moved: Mapping[int, int]) -> list[Pair]:
        """Mark all that may have touched these bodies (as ``unexplained``) from then on; the pairs."""
        bodies, found = self.given.header.bodies, []
        for i, frame in moved.items():
            name, since = bodies[i].name, float(self.given.t[frame])
            self.unrecorded[i] = (
                f"{name} lay still and moved from {since:.2f} s on, though nothing that moves touched "
                "it: what touched it was not recorded"
            )
            for j, other in enumerate(bodies):
                if j != i and other.movable and other.kind != "region":
                    pair = (min(i, j), max(i, j))
                    self.mark(pair, np.arange(frame + 1, self.frames), self.unrecorded[i])
                    found.append(pair)
        return found

    @cached_property
    def forces(self) -> bool:
        """Contact forces were recorded.

        Not where the header says so and all of them are zero, though a free body stays in its place
        against gravity; or may have, where that is too short or too coarse to tell and no peak shows a
        touch. Peaks beside them are no forces.
        """
        episode = self.episode
        if episode.header.force_source == "none":
            return False
        if not self.whole:
            return True
        contacts = episode.contacts
        free = {
            i
            for i, body in enumerate(episode.header.bodies)
            if body.kind == "object" and body.movable and body.parent is None
        }
        pairs = sorted(contacts.pairs, key=lambda pair: not (pair[0] in free or pair[1] in free))
        for pair in pairs:
            (force,) = contacts.of_pair(pair, "force.z")
            if force.any() or pair in self._forces:
                return True
        for pair in pairs:
            if contacts.of_pair(pair, "force")[0].any():
                return True
        if any(contacts.of_pair(pair, "peak_force")[0].any() for pair in pairs):
            return not any(self._stays(i) for i in free)
        if pairs and episode.clock.coarse.any():
            return False
        return all(self._stays(i) is False for i in free)

    def _stays(self, body: int) -> bool | None:
        """Whether a body (index) stays in its place; None where too little of it was measured."""
        record = self.given.header.bodies[body]
        if record.mass == 0 or not record.geoms:
            return False
        place = self.episode.track(record.name).position
        lost = self.of_bodies([record.name], ("position",))
        seen = np.arange(self.frames) if lost is None else np.flatnonzero(~lost)
        place, t = place[seen], self.given.t[seen]
        at = np.arange(len(seen))
        last = np.maximum(np.searchsorted(t, t + STILL - 1e-9), at + SAMPLES - 1)
        first = at[last < len(at)]
        if not len(first):
            return None
        last = last[first]
        near = [np.abs(place[i] - place[first]).max(axis=1) < PLACE
                for i in ((first + last) // 2, last)]  # fmt: skip
        return bool(np.logical_and(*near).any())

    @property
    def about_forces(self) -> str:
        """Why there are no contact forces; empty where they were recorded."""
        if self.forces:
            return ""
        if self.given.header.force_source == "none":
            return "the trace has no contact forces"
        return "the trace has no contact forces: all are zero, though bodies rest on others"


def either(*masks: Bool | None) -> Bool | None:
    """(T,) where one of several masks is true; None, which is true nowhere, where all are."""
    out: Bool | None = None
    for mask in masks:
        if mask is not None:
            out = mask if out is None else out | mask
    return out


def filled(values: NDArray[Any], lost: Bool) -> NDArray[Any]:
    """(T, k) values with the last measured row in place of lost ones; the first one at the start."""
    if lost.all():
        found = np.zeros_like(values)
        found[:, 0] = values.shape[1] == 4  # a quaternion that turns nothing
        return found
    at = np.maximum.accumulate(np.where(lost, 0, np.arange(len(values))))
    at = np.where(lost & (at == 0) & lost[0], int((~lost).argmax()), at)
    return values[at]


def around(lost: Bool) -> Bool:
    """(T,) true there and in the frame before and after."""
    found = lost.copy()
    found[1:] |= lost[:-1]
    found[:-1] |= lost[1:]
    return found


class _CleanContacts(ContactTable):
    """Contacts pair by pair, with 0 in place of NaN; whole columns are as they were recorded."""

    def __init__(self, table: ContactTable, gaps: Gaps) -> None:
        vars(self).update(_table=table, _gaps=gaps, _clean={})

    def __getattr__(self, name: str) -> Any:
        """Whole columns."""
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(vars(self)["_table"], name)

    def __len__(self) -> int:
        return len(vars(self)["_table"])

    @property
    def pairs(self) -> list[Pair]:
        """The pairs that touch."""
        found: list[Pair] = vars(self)["_table"].pairs
        return found

    def rows(self, pair: Pair) -> NDArray[np.intp]:
        """Rows of a pair in the table."""
        found: NDArray[np.intp] = vars(self)["_table"].rows(pair)
        return found

    def of_pair(self, pair: Pair, *columns: str) -> tuple[NDArray[Any], ...]:
        """Columns of a pair, with 0 in place of what is not finite; the gaps are marked."""
        table, gaps, clean = (vars(self)[name] for name in ("_table", "_gaps", "_clean"))
        gaps.asked.setdefault(pair, set()).update(columns)
        missing = [column for column in columns if (pair, column) not in clean]
        for column, values in zip(missing, table.of_pair(pair, *missing), strict=True):
            clean[pair, column] = values
            if values.dtype.kind == "f" and not all_finite(values):
                bad = ~np.isfinite(values)
                clean[pair, column] = np.where(bad, 0, values)
                if column != "depth":
                    (frame,) = table.of_pair(pair, "frame")
                    frame, peak = (
                        frame[bad.reshape(len(bad), -1).any(axis=1)],
                        column == "peak_force",
                    )
                    number = "NaN" if not np.isinf(values).any() else "an infinite number"
                    why = f"it is {number}" if peak else f"a contact of theirs holds {number}"
                    if gaps.in_doubt(pair, "peak_force" if peak else "contacts"):
                        why = f"their {'peaks' if peak else 'contacts'} contradict other columns"
                    gaps.mark(pair, frame, why, peak=peak)
        return tuple(clean[pair, column] for column in columns)
