"""Reading an episode from a Parquet dataset, whole."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from safestage_eval.episode import (
    ContactTable,
    Episode,
    Mesh,
    RobotFrames,
    Track,
    check_contacts,
    check_frames,
    check_header,
    check_time,
    check_track,
)
from safestage_eval.errors import TraceError
from safestage_eval.formats.lazy_columns import StoredItems
from safestage_eval.formats.ply import from_ply
from safestage_eval.formats.trace_files import existing, inside_dataset, regular_status
from safestage_eval.size_limits import current

from . import dataset_layout as layout
from .arrow_tables import CONTACT_VECTORS, ROBOT_COLUMNS, WXYZ, XYZ
from .arrow_values import codes, lists, numbers, pylist
from .episode_row import from_row
from .episodes_table import read_row
from .stored_scene import find_scene, make_scene
from .table_file import TableFile

Kind = TypeVar("Kind")

_TRACK = {
    column: tuple(f"{column}.{axis}" for axis in (WXYZ if column == "orientation" else XYZ))
    for column in ("position", "orientation", "linear_velocity", "angular_velocity")
}
"""Column of a track → the stored columns that it is made of."""

_VECTORS = {column: tuple(f"{column}.{axis}" for axis in XYZ) for column in CONTACT_VECTORS}

MOST_GEOMS = 1 << 16
"""Contacts tell geoms by numbers of 16 bits."""


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def open_episode(file: Path, episode_index: int, *, checked: bool = True) -> Episode:
    """Read the episode with an index, whose row stands in a file of ``meta/episodes``.

    Args:
        file: of ``meta/episodes``.
        episode_index: which of its rows.
        checked: raise on broken invariants; without it the episode comes as it is, for ``check`` to
            list all that is wrong.

    Raises:
        TraceError: a file or column is missing or damaged, or an invariant is broken.
    """
    return _StoredEpisode(file, read_row(file, episode_index), checked).episode()


class _StoredEpisode:
    """Where the rows of one episode are, and how they become its parts."""

    def __init__(self, file: Path, row: Mapping[str, Any], checked: bool) -> None:
        self.file, self.row, self.checked = file, row, checked
        self.dataset = file.parents[2]
        self.index: int = row["episode_index"]
        self.length: int = row["length"]
        self.where = f"{file} ({row['episode_id']})"
        layout.check_version(row.get("schema_version") or "1.0", self.where)
        current().demand("frames", self.length, self.where)
        most = current().contacts * max(self.length, 1)
        if (row.get("contacts") or 0) > most:
            current().demand("contacts", row["contacts"] // max(self.length, 1), self.where)

    def episode(self) -> Episode:
        geometry = self.table("geometry")
        shapes = geometry.read((n for n in geometry.types if n != "episode_index"), self.index)
        if len(shapes) > MOST_GEOMS:
            raise TraceError(self.where, f"{len(shapes):,} geoms.", f"{MOST_GEOMS:,} at most")
        current().demand("geoms", len(shapes), self.where)
        text = self.row.get("bodies"), self.row.get("joints")
        scene = find_scene(text, shapes)
        columns = {} if scene else {name: pylist(shapes[name]) for name in shapes.column_names}
        rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
        known_parts = {} if scene is None else {"bodies": scene.bodies, "joints": scene.joints}
        header = from_row(self.row, rows, self.where, known_parts)
        frames_table = self.table("frames")
        rows_of_frames = frames_table.read(
            ("frame_index", "timestamp", *ROBOT_COLUMNS.values()), self.index
        )
        t = self.time(rows_of_frames)
        if self.checked:
            known = scene is not None and scene.sound
            self.demand(list(check_header(header, self.where, shapes=not known)))
            self.demand(check_time(t, self.where))
        if scene is None or scene.sound < self.checked:
            scene = make_scene(text, shapes, header, sound=self.checked)
        files = existing(
            self.dataset, layout.ASSETS, (f"{key}.ply" for key in scene.meshes), self.where
        )
        stored = [name.removesuffix(".ply") for name in files]
        if self.checked and stored != scene.meshes:
            key = next(key for key in scene.meshes if key not in stored)
            raise TraceError(
                self.where,
                f"the mesh {key[:12]}… is missing.",
                str(self.asset(f"{key}.ply")),
                "copy the dataset's assets folder too",
            )
        attachments = self.named("attachments", dict[str, str], "{}")
        channels = self.named("channels", list[tuple[str, str]], "[]")
        return Episode(
            header=header,
            t=t,
            tracks=self.tracks(scene.places),
            _contacts=self.contacts(scene.places, scene.owner),
            _frames=self.robot(rows_of_frames, frames_table.path),
            meshes=StoredItems(stored, self.mesh),
            channels=self.channels(channels) if channels else {},
            states=self.states() if self.row.get("states") else {},
            attachments=StoredItems(attachments, lambda name: self.attachment(attachments[name])),
            path=self.file,
        )

    def named(self, column: str, kind: type[Kind], default: str) -> Kind:
        """Read a column of the row that holds JSON. Raises TraceError for another kind of value."""
        try:
            value: Kind = _adapter(cast(Hashable, kind)).validate_json(
                self.row.get(column) or default
            )
            return value
        except ValidationError as error:
            first = error.errors(include_url=False)[0]["msg"]
            raise TraceError(f"{self.where}, column {column}", f"{first}.") from None

    def table(self, name: str) -> TableFile:
        file = inside_dataset(self.dataset, name, f"{self.row['file']}.parquet", self.where)
        return TableFile(file, name)

    def asset(self, name: str) -> Path:
        return inside_dataset(self.dataset, layout.ASSETS, name, self.where)

    def asset_bytes(self, name: str) -> bytes:
        """Read a file under ``assets``. Raises TraceError when it is missing or no regular file."""
        path = self.asset(name)
        try:
            regular_status(path)
            return path.read_bytes()
        except OSError as error:
            raise TraceError(
                self.where,
                f"{path} cannot be read: {error.strerror}.",
                fix="copy the dataset's assets folder too",
            ) from None

    def attachment(self, name: str) -> bytes:
        """Read an attachment. Raises TraceError where its content is not that of its name."""
        data = self.asset_bytes(name)
        if sha256(data).hexdigest() != Path(name).stem:
            raise TraceError(
                self.where,
                f"the file {name} in {layout.ASSETS} has changed since it was written.",
                "files named after the SHA-256 of their content",
                "restore the file",
            )
        return data

    def mesh(self, key: str) -> Mesh:
        name = f"{key}.ply"
        return from_ply(self.asset_bytes(name), key, str(self.asset(name)))

    def demand(self, errors: list[TraceError]) -> None:
        """Raise the first of the errors, when the episode is to be checked."""
        if self.checked and errors:
            raise errors[0]

    def in_order(self, frame: NDArray[Any], owner: str, rows: int) -> None:
        """Raise TraceError for rows that are not those of frames 0, 1, 2, and so on."""
        if len(frame) != rows or (frame != np.arange(rows, dtype=frame.dtype)).any():
            raise TraceError(
                self.where,
                f"{owner} has {len(frame)} rows that are not the frames 0…{rows - 1} in order.",
                "one row per frame, ascending",
            )

    def time(self, rows: pa.Table) -> NDArray[np.float64]:
        self.in_order(numbers(rows, "frame_index", np.int32, self.where), "frames", self.length)
        return numbers(rows, "timestamp", np.float64, self.where)

    def robot(self, rows: pa.Table, path: Path) -> RobotFrames:
        frames = RobotFrames(
            *(lists(rows, name, np.float32, str(path)) for name in ROBOT_COLUMNS.values())
        )
        self.demand(check_frames(frames, self.length, self.where))
        return frames

    def tracks(self, places: dict[str, int]) -> dict[str, Track]:
        table = self.table("bodies")
        path = str(table.path)
        rows = table.read(
            ("frame_index", "body", *(n for c in _TRACK.values() for n in c)), self.index
        )
        body = codes(rows, "body", places, path)
        frame = numbers(rows, "frame_index", np.int32, path)
        columns = [_stacked(rows, names, path) for names in _TRACK.values()]
        starts = np.flatnonzero(np.diff(body, prepend=-1))
        if len(starts) > len(np.unique(body)):  # rows of a body are not together
            order = np.argsort(body, kind="stable")
            body, frame, *columns = (values[order] for values in (body, frame, *columns))
            starts = np.flatnonzero(np.diff(body, prepend=-1))
        spans = dict(
            zip(
                body[starts].tolist(),
                zip(starts, [*starts[1:], len(body)], strict=True),
                strict=True,
            )
        )
        tracks = {}
        for name, place in places.items():
            if place not in spans:
                raise TraceError(self.where, f"body {name!r} has no poses in {path}")
            begin, end = spans[place]
            self.in_order(
                frame[begin:end], f"body {name!r}", 1 if end - begin == 1 else self.length
            )
            tracks[name] = track = Track(*(values[begin:end] for values in columns))
            self.demand(check_track(track, name, self.length, self.where))
        return tracks

    def contacts(self, places: dict[str, int], owner: NDArray[np.int16]) -> ContactTable:
        table = self.table("contacts")
        path = str(table.path)
        plain = {"geom1": np.uint16, "geom2": np.uint16}
        single = {"peak_force": np.float32, "depth": np.float32}
        names = ("frame_index", "slot", "body1", "body2", *plain, *single)
        rows = table.read((*names, *(n for c in _VECTORS.values() for n in c)), self.index)
        if len(rows) != self.row["contacts"]:
            raise TraceError(
                self.where, f"{path} has {len(rows)} contacts, not {self.row['contacts']}"
            )
        frame = numbers(rows, "frame_index", np.int32, path)
        slot = numbers(rows, "slot", np.int16, path)
        body1, body2 = (codes(rows, name, places, path) for name in ("body1", "body2"))
        order = _frame_order(frame, slot, body1, body2)
        columns: dict[str, NDArray[Any]] = {"frame": frame, "body1": body1, "body2": body2}
        columns |= {
            name: numbers(rows, name, kind, path) for name, kind in (plain | single).items()
        }
        columns |= {name: _stacked(rows, parts, path) for name, parts in _VECTORS.items()}
        contacts = ContactTable(**{name: c.take(order, axis=0) for name, c in columns.items()})
        if self.checked:
            self.demand(list(check_contacts(contacts, owner, self.length, self.where)))
        return contacts

    def channels(self, keys: list[tuple[str, str]]) -> dict[tuple[str, str], NDArray[np.float32]]:
        table = self.table("channels")
        path = str(table.path)
        rows = table.read(("frame_index", "body", "name", "value"), self.index)
        frame = numbers(rows, "frame_index", np.int32, path)
        values = numbers(rows, "value", np.float32, path)
        body, name = (np.array(pylist(rows[column]), object) for column in ("body", "name"))
        channels = {}
        for key in keys:
            own, title = (body == key[0]) & (name == key[1]), f"channel {key[1]!r} of {key[0]!r}"
            self.in_order(frame[own], title, self.length)
            channels[key] = values[own]
        return channels

    def states(self) -> dict[int, NDArray[np.float64]]:
        table = self.table("states")
        path = str(table.path)
        rows = table.read(("frame_index", "state"), self.index)
        frames = numbers(rows, "frame_index", np.int64, path).tolist()
        states = lists(rows, "state", np.float64, path)
        return dict(zip(frames, states, strict=True))


def _stacked(rows: pa.Table, names: tuple[str, ...], where: str) -> NDArray[np.float32]:
    """(N, C) numbers of some columns."""
    out = np.empty((len(rows), len(names)), np.float32)
    for i, name in enumerate(names):
        out[:, i] = numbers(rows, name, np.float32, where)
    return out


def _frame_order(
    frame: NDArray[np.int32],
    slot: NDArray[np.int16],
    body1: NDArray[np.int16],
    body2: NDArray[np.int16],
) -> NDArray[np.intp]:
    """Order of rows in the canonical table: by frame, pair, slot."""
    pair = body1.astype(np.int32) << 16 | body2
    step = np.diff(pair)
    if ((step < 0) | ((step == 0) & (np.diff(slot) < 0))).any():
        return np.lexsort((slot, pair, frame))
    # as we write it, by pair and slot: a stable sort by frame is all that is left
    small = (
        frame.astype(np.uint16)
        if len(frame) and 0 <= frame.min() <= frame.max() < 1 << 16
        else frame
    )
    return np.argsort(small, kind="stable")
