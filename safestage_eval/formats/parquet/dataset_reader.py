"""Reading an episode from a Parquet dataset, whole."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from safestage_eval.episode import (
    Body,
    ContactTable,
    Episode,
    Header,
    Joint,
    Mesh,
    RobotFrames,
    Track,
    check_contacts,
    check_frames,
    check_header,
    check_time,
    check_track,
    sound_motion,
)
from safestage_eval.episode.lazy_columns import StoredItems
from safestage_eval.errors import TraceError
from safestage_eval.formats.contact_points import GeomNames
from safestage_eval.formats.ply import from_ply
from safestage_eval.formats.trace_files import inside_dataset, lacking, regular_status
from safestage_eval.size_limits import current

from . import dataset_layout as layout
from .arrow_columns import Words, arrays, records
from .arrow_tables import ROBOT_COLUMNS, columns_of
from .episode_row import read_row, to_header
from .table_file import TableFile

Kind = TypeVar("Kind")

TRACK_COLUMNS = ("position", "orientation", "linear_velocity", "angular_velocity")

MOST_GEOMS = 1 << 16
"""Contacts tell geoms by numbers of 16 bits."""

_SCENES_KEPT = 32


class _Scene(NamedTuple):
    """What sound episodes of a task share, understood once.

    Attributes:
        text: its bodies and joints as they are stored.
        shapes: rows of ``geometry``.
        bodies, joints: the same, understood.
        geoms: which of its geoms belong to which body.
        meshes: keys of the meshes that geoms have, each once.
    """

    text: tuple[Any, Any]
    shapes: pa.Table
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    geoms: GeomNames
    meshes: list[str]


_SCENES: list[_Scene] = []
"""Those that were met last."""


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
        self.length: int = row["length"]
        self.where = f"{file} ({row['episode_id']})"
        layout.check_version(row.get("schema_version") or "1.0", self.where)
        current().demand("frames", self.length, self.where)
        current().demand("contacts", row["contacts"] // max(self.length, 1), self.where)

    def episode(self) -> Episode:
        header, scene = self.header()
        frames, _ = self.columns("frames")
        self.in_order(frames["frame_index"], "frames", self.length)
        t = frames["timestamp"]
        robot = RobotFrames(*(frames[name] for name in ROBOT_COLUMNS.values()))
        self.demand(check_time(t, self.where))
        self.demand(check_frames(robot, self.length, self.where))
        assets = self.dataset / layout.ASSETS
        missing = lacking(assets, [f"{key}.ply" for key in scene.meshes])
        if self.checked and missing:
            raise TraceError(
                self.where,
                f"the mesh {missing[0][:12]}… is missing.",
                str(assets / missing[0]),
                "copy the dataset's assets folder too",
            )
        stored = [key for key in scene.meshes if f"{key}.ply" not in missing]
        attachments = self.named("attachments", dict[str, str], "{}")
        channels = self.named("channels", list[tuple[str, str]], "[]")
        places = {body.name: i for i, body in enumerate(scene.bodies)}
        return Episode(
            header=header,
            t=t,
            tracks=self.tracks(places),
            _contacts=self.contacts(places, scene.geoms.owner),
            _frames=robot,
            meshes=StoredItems(stored, self.mesh),
            channels=self.channels(channels) if channels else {},
            states=self.states() if self.row.get("states") else {},
            attachments=StoredItems(attachments, lambda name: self.attachment(attachments[name])),
            path=self.file,
        )

    def header(self) -> tuple[Header, _Scene]:
        """The header, and its scene: kept if it is sound, so that both are understood once."""
        table = self.table("geometry")
        shapes = table.read(table.described, self.row["episode_index"])
        if len(shapes) > MOST_GEOMS:
            raise TraceError(self.where, f"{len(shapes):,} geoms.", f"{MOST_GEOMS:,} at most")
        current().demand("geoms", len(shapes), self.where)
        text = self.row.get("bodies"), self.row.get("joints")
        for scene in _SCENES:
            if scene.text == text and scene.shapes.equals(shapes):
                known = {"bodies": scene.bodies, "joints": scene.joints}
                header = to_header(self.row, [], self.where, known)
                self.demand(list(check_header(header, self.where, shapes=False)))
                return header, scene
        rows = records(shapes, "geometry", str(table.path))
        header = to_header(self.row, rows, self.where, {})
        self.demand(list(check_header(header, self.where)))
        scene = _Scene(
            text, shapes, header.bodies, header.joints, GeomNames(header), header.mesh_keys
        )
        if self.checked:
            _SCENES[:] = [scene, *_SCENES][:_SCENES_KEPT]
        return header, scene

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

    def columns(self, name: str) -> tuple[dict[str, Any], str]:
        """The episode's rows of a table as arrays, and the file that they are from."""
        table = self.table(name)
        rows = table.read(columns_of(name), self.row["episode_index"])
        return arrays(rows, name, str(table.path)), str(table.path)

    def asset(self, name: str) -> tuple[bytes, str]:
        """Read a file under ``assets``; return its path, too. Raises TraceError where it is no file."""
        path = inside_dataset(self.dataset, layout.ASSETS, name, self.where)
        try:
            regular_status(path)
            return path.read_bytes(), str(path)
        except OSError as error:
            raise TraceError(
                self.where,
                f"{path} cannot be read: {error.strerror}.",
                fix="copy the dataset's assets folder too",
            ) from None

    def attachment(self, name: str) -> bytes:
        """Read an attachment. Raises TraceError where its content is not that of its name."""
        data, _ = self.asset(name)
        if sha256(data).hexdigest() != Path(name).stem:
            raise TraceError(
                self.where,
                f"the file {name} in {layout.ASSETS} has changed since it was written.",
                "files named after the SHA-256 of their content",
                "restore the file",
            )
        return data

    def mesh(self, key: str) -> Mesh:
        data, path = self.asset(f"{key}.ply")
        return from_ply(data, key, path)

    def demand(self, errors: list[TraceError]) -> None:
        """Raise the first of the errors, when the episode is to be checked."""
        if self.checked and errors:
            raise errors[0]

    def in_order(self, frame: NDArray[np.int32], owner: str, rows: int) -> None:
        """Raise TraceError for rows that are not those of frames 0, 1, 2, and so on."""
        if len(frame) != rows or (frame != np.arange(rows, dtype=frame.dtype)).any():
            raise TraceError(
                self.where,
                f"{owner} has {len(frame)} rows that are not the frames 0…{rows - 1} in order.",
                "one row per frame, ascending",
            )

    def tracks(self, places: dict[str, int]) -> dict[str, Track]:
        columns, path = self.columns("bodies")
        body = columns["body"].among(places, "body", path)
        frame, motion = columns["frame_index"], [columns[name] for name in TRACK_COLUMNS]
        sound = sound_motion(*motion)
        if (np.diff(body) != 0).sum() >= len(places):  # rows of a body are not together
            order = np.argsort(body, kind="stable")
            body, frame, *motion = (values[order] for values in (body, frame, *motion))
        begins = np.flatnonzero(np.diff(body, prepend=-1))
        spans = dict(
            zip(
                body[begins].tolist(),
                zip(begins, [*begins[1:], len(body)], strict=True),
                strict=True,
            )
        )
        tracks = {}
        for name, place in places.items():
            if place not in spans:
                raise TraceError(self.where, f"body {name!r} has no poses in {path}")
            begin, end = spans[place]
            rows = 1 if end - begin == 1 else self.length
            self.in_order(frame[begin:end], f"body {name!r}", rows)
            tracks[name] = track = Track(*(values[begin:end] for values in motion))
            if not sound:
                self.demand(check_track(track, name, self.length, self.where))
        return tracks

    def contacts(self, places: dict[str, int], owner: NDArray[np.int16]) -> ContactTable:
        columns, path = self.columns("contacts")
        del columns["episode_index"]
        frame, slot = columns.pop("frame_index"), columns.pop("slot")
        if len(frame) != self.row["contacts"]:
            raise TraceError(
                self.where, f"{path} has {len(frame)} contacts, not {self.row['contacts']}"
            )
        for name in ("body1", "body2"):
            columns[name] = columns[name].among(places, name, path)
        order = _frame_order(frame, slot, columns["body1"], columns["body2"])
        columns |= {"frame": frame}
        contacts = ContactTable(**{name: c.take(order, axis=0) for name, c in columns.items()})
        if self.checked:
            self.demand(check_contacts(contacts, owner, self.length, self.where))
        return contacts

    def channels(self, keys: list[tuple[str, str]]) -> dict[tuple[str, str], NDArray[np.float32]]:
        columns, _ = self.columns("channels")
        body, name = columns["body"], columns["name"]
        channels = {}
        for key in keys:
            own = _is(body, key[0]) & _is(name, key[1])
            title = f"channel {key[1]!r} of {key[0]!r}"
            self.in_order(columns["frame_index"][own], title, self.length)
            channels[key] = columns["value"][own]
        return channels

    def states(self) -> dict[int, NDArray[np.float64]]:
        columns, _ = self.columns("states")
        return dict(zip(columns["frame_index"].tolist(), columns["state"], strict=True))


def _is(words: Words, name: str) -> NDArray[np.bool_]:
    """(N,) true where a column has a name."""
    place = words.names.index(name) if name in words.names else -1
    return np.asarray(words.places == place)


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
    # as we write it, by pair and slot: a stable sort by frame is all that is left, of two bytes a quick one
    small = len(frame) > 0 and 0 <= frame.min() <= frame.max() < 1 << 16
    return np.argsort(frame.astype(np.uint16) if small else frame, kind="stable")
