"""Values of an episode that were not recorded, per frame.

Missing are: a body's pose or velocity where it is NaN; everything at the frames of
``Episode.unseen``; the force of a pair of bodies where a contact of theirs holds NaN, a normal that
is not of unit length, or a force that pulls. Signals are computed from the cleaned episode, in which
the last measured value stands in a gap, and are then made unknown there (``Signals``,
``Relations``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import ContactTable, Episode, Track
from safestage_eval.episode.contacts import Pair
from safestage_eval.episode.invariants import all_finite

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
        self._pairs: dict[Pair, Bool] = {}
        self._why: dict[Pair, str] = {}
        self.read: set[Pair] = set()
        """Pairs of which forces or normals were read."""
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
        vars(clean)["tracks"] = _CleanTracks(given.tracks, self._clean)
        vars(clean)["_contacts"] = lambda: _CleanContacts(given.contacts, self)
        vars(clean).pop("contacts", None)
        return clean

    # ---- tracks

    def _clean(self, body: str, column: str, values: NDArray[np.float32]) -> NDArray[Any]:
        """A column as it is used, after noting where it was not measured."""
        known = self._tracks.setdefault(body, {})
        if all_finite(values):
            known[column] = None
            return values
        lost: Bool = ~np.asarray(np.isfinite(values).all(axis=1))
        if not lost.any():
            known[column] = None
            return values
        if lost.all() and column in TWIST:  # never recorded: derived from poses, like zeros
            known[column] = None
            return np.zeros_like(values)
        known[column] = lost
        return filled(values, lost)

    def of_body(self, body: str, columns: Iterable[str]) -> Bool | None:
        """(T,) true where one of these columns of a body was not measured; None if nowhere."""
        found = None
        for column in columns:
            known = self._tracks.get(body, {})
            if column not in known:
                getattr(self.episode.tracks[body], column)
                known = self._tracks[body]
            lost = known[column]
            if lost is not None:
                lost = np.broadcast_to(lost, self.frames)
                found = lost if found is None else found | lost
        return found

    def of_bodies(self, bodies: Iterable[str], columns: Iterable[str] = POSE) -> Bool | None:
        """Gaps of several bodies, and frames without any record."""
        found, columns = self.unseen, tuple(columns)
        for body in bodies:
            lost = self.of_body(body, columns)
            if lost is not None:
                found = lost if found is None else found | lost
        return found

    def of_loaded(self) -> Bool | None:
        """(T,) true where a pose that was looked at so far was not measured; None if nowhere."""
        found = self.unseen
        for known in self._tracks.values():
            for column in POSE:
                lost = known.get(column)
                if lost is not None:
                    lost = np.broadcast_to(lost, self.frames)
                    found = lost if found is None else found | lost
        return found

    def knows(self, body: str, column: str | None = None) -> bool:
        """Whether a column of a body's track was looked at; or any."""
        known = self._tracks.get(body, {})
        return bool(known) if column is None else column in known

    # ---- contacts

    def mark(self, pair: Pair, frames: NDArray[np.integer], why: str) -> None:
        """Note that the force between two bodies (indices) is not known at some frames."""
        lost = self._pairs.setdefault(pair, np.zeros(self.frames, np.bool_))
        lost[frames] = True
        self._why.setdefault(pair, why)

    def of_pair(self, i: int, j: int) -> Bool | None:
        """(T,) true where their force is not known, of what was read so far; None if nowhere."""
        lost = self._pairs.get((min(i, j), max(i, j)))
        if lost is None or self.unseen is None:
            return self.unseen if lost is None else lost
        return lost | self.unseen

    def of_pairs(self, pairs: Iterable[Pair]) -> Bool | None:
        """Gaps of several pairs."""
        found = self.unseen
        for pair in pairs:
            lost = self._pairs.get((min(pair), max(pair)))
            if lost is not None:
                found = lost if found is None else found | lost
        return found

    @property
    def pairs(self) -> list[Pair]:
        """Pairs that are known to have frames at which their force is unknown."""
        return list(self._pairs)

    def told(self, pairs: Iterable[Pair]) -> tuple[str, ...]:
        """A note on each of the pairs that has such frames."""
        names = [body.name for body in self.given.header.bodies]
        found = []
        for pair in dict.fromkeys((min(pair), max(pair)) for pair in pairs):
            lost = self._pairs.get(pair)
            if lost is not None:
                at, many = int(lost.argmax()), int(lost.sum())
                found.append(
                    f"the force between {names[pair[0]]} and {names[pair[1]]} is not known in "
                    f"{many} frames from {self.given.t[at]:.3f} s on: {self._why[pair]}"
                )
        return tuple(found)

    @cached_property
    def forces(self) -> bool:
        """Contact forces were recorded.

        Not where the header says so and all of them are zero, though a free body stays in its place
        against gravity; or may have, where that is too short or too coarse to tell.
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
            if force.any() or pair in self._pairs:
                return True
        for pair in pairs:
            if any(values.any() for values in contacts.of_pair(pair, "force", "peak_force")):
                return True
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


class _CleanTracks(Mapping[str, Track]):
    """Tracks without NaN."""

    def __init__(
        self,
        tracks: Mapping[str, Track],
        clean: Callable[[str, str, NDArray[np.float32]], NDArray[Any]],
    ) -> None:
        self._tracks, self._clean = tracks, clean
        self._known: dict[str, Track] = {}

    def __getitem__(self, name: str) -> Track:
        if name not in self._known:
            track, clean = self._tracks[name], self._clean

            def load(column: str) -> NDArray[Any]:
                return clean(name, column, getattr(track, column))

            self._known[name] = _CleanTrack(load)
        return self._known[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._tracks)

    def __len__(self) -> int:
        return len(self._tracks)

    def __contains__(self, name: object) -> bool:
        return name in self._tracks


class _CleanTrack(Track):
    """A track of which each column is loaded and cleaned when it is first asked for."""

    def __init__(self, load: Callable[[str], NDArray[Any]]) -> None:
        object.__setattr__(self, "_load", load)

    def __getattr__(self, name: str) -> Any:
        """Reached only for columns that are not loaded yet."""
        if name not in (*POSE, *TWIST):
            raise AttributeError(name)
        found = self.__dict__[name] = self.__dict__["_load"](name)
        return found

    def over(self, frames: int) -> Track:
        """The track over so many frames; only what is looked at is read."""
        if len(self) == frames:
            return self
        if len(self) != 1:
            return super().over(frames)
        return _CleanTrack(
            lambda name: np.broadcast_to(
                getattr(self, name), (frames, getattr(self, name).shape[1])
            )
        )


class _CleanContacts(ContactTable):
    """Contacts pair by pair, with 0 in place of NaN; whole columns are as they were recorded."""

    def __init__(self, table: ContactTable, gaps: Gaps) -> None:
        vars(self).update(_table=table, _gaps=gaps, _clean={}, _whole=set())

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
        whole: set[tuple[Pair, str]] = vars(self)["_whole"]
        found = list(table.of_pair(pair, *columns))
        gaps.asked.setdefault(pair, set()).update(columns)
        if "normal" in columns or "force" in columns:
            gaps.read.add(pair)
        for i, values in enumerate(found):
            if values.dtype.kind != "f" or (pair, columns[i]) in whole:
                continue
            known = clean.get((pair, columns[i]))
            if known is not None:
                found[i] = known
                continue
            if all_finite(values):
                whole.add((pair, columns[i]))
            else:
                bad = ~np.isfinite(values)
                rows = bad.reshape(len(values), -1).any(axis=1)
                if rows.any() and not columns[i].startswith("depth"):
                    (frame,) = table.of_pair(pair, "frame")
                    gaps.mark(pair, frame[rows], "a contact of theirs holds NaN")
                found[i] = clean[pair, columns[i]] = np.where(bad, 0, values)
        return tuple(found)
