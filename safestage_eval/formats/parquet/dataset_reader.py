"""Reading an episode from a Parquet dataset, column by column as it is looked at."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from functools import cache, partial
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
    check_finite,
    check_frames,
    check_header,
    check_time,
    check_track_column,
)
from safestage_eval.errors import TraceError
from safestage_eval.formats.digests import Seal, computed
from safestage_eval.formats.lazy_columns import StoredItems, StoredTrack
from safestage_eval.formats.ply import from_ply
from safestage_eval.formats.trace_files import existing, inside_dataset, regular_status
from safestage_eval.size_limits import current

from . import dataset_layout as layout
from .arrow_tables import ROBOT_COLUMNS, WXYZ, XYZ
from .episode_row import from_row
from .episodes_table import read_row
from .stored_contacts import MOSTLY_READ, Source, StoredContacts
from .stored_scene import find_scene, make_scene
from .stored_table import Block, StoredTable
from .table_digests import DIGESTED_TABLES

Kind = TypeVar("Kind")

_FRAME = Block(("frame_index",), np.dtype(np.int32))
_TRACK = {
    column: Block(
        tuple(f"{column}.{axis}" for axis in (WXYZ if column == "orientation" else XYZ)),
        np.dtype(np.float32),
    )
    for column in ("position", "orientation", "linear_velocity", "angular_velocity")
}
"""Column of a track → the stored columns that it is made of."""

_TIME = Block(("timestamp",), np.dtype(np.float64))

FEW_CONTACTS = 1 << 16
"""Rows up to which those of all pairs are read at once: of a short episode most are asked for."""

MOST_GEOMS = 1 << 16
"""Contacts tell geoms by numbers of 16 bits."""


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def open_episode(
    file: Path, episode_index: int, *, checked: bool = True, whole: bool = False
) -> Episode:
    """Open the episode with an index, whose row stands in a file of ``meta/episodes``.

    Header and time are read now, tracks, contacts and the rest when first asked for.

    Args:
        file: of ``meta/episodes``.
        episode_index: which of its rows.
        checked: raise on broken invariants, now or when a column is loaded; without it the episode
            comes as it is, for ``check`` to list all that is wrong.
        whole: read the columns of a table at once when the first of them is asked for, because all
            will be used.

    Raises:
        TraceError: a file or column is missing or damaged, or an invariant is broken.
    """
    return _StoredEpisode(file, read_row(file, episode_index), checked, whole=whole).episode()


class _StoredEpisode:
    """Where the columns of one episode are, and how to load them."""

    def __init__(
        self, file: Path, row: Mapping[str, Any], checked: bool, *, whole: bool = False
    ) -> None:
        self.file, self.row, self.checked = file, row, checked
        self.dataset = file.parents[2]
        self.index: int = row["episode_index"]
        self.length: int = row["length"]
        self.where = f"{file} ({row['episode_id']})"
        self._in_order: set[str] = set()
        self.seal = Seal(
            row.get("content_hash"), row.get("digests"), partial(_recomputed, file, row), self.where
        )
        hashed = checked and self.seal.digests is None  # its content hash will be computed
        self.whole = whole or hashed
        layout.check_version(row.get("schema_version") or "1.0", self.where)
        current().demand("frames", self.length, self.where)
        most = current().contacts * max(self.length, 1)
        if (row.get("contacts") or 0) > most:
            current().demand("contacts", row["contacts"] // max(self.length, 1), self.where)

    def episode(self) -> Episode:
        geometry = self.table("geometry")
        names = [name for name in geometry.names if name != "episode_index"]
        shapes = self.few(geometry.rows(names, self.index))
        current().demand("geoms", len(shapes), self.where)
        text = self.row.get("bodies"), self.row.get("joints")
        scene = find_scene(text, shapes)
        rows = [] if scene else shapes.to_pylist()
        known_parts = {} if scene is None else {"bodies": scene.bodies, "joints": scene.joints}
        header = from_row(self.row, rows, self.where, known_parts)
        self.frames_table = self.table("frames")
        t = self.time()
        if self.checked:
            known = scene is not None and scene.sound
            self.demand(list(check_header(header, self.where, shapes=not known)))
            self.demand(check_time(t, self.where))
        if scene is None or scene.sound < self.checked:
            scene = make_scene(text, shapes, header, sound=self.checked)
        self.body_index = scene.places
        self.bodies_table = self.table("bodies")
        meshes = scene.meshes
        attachments = self.named("attachments", dict[str, str], "{}")
        files = existing(self.dataset, layout.ASSETS, (f"{key}.ply" for key in meshes), self.where)
        stored = [name.removesuffix(".ply") for name in files]
        if self.checked and stored != meshes:
            key = next(key for key in meshes if key not in stored)
            raise TraceError(
                self.where,
                f"the mesh {key[:12]}… is missing.",
                str(self.asset(f"{key}.ply")),
                "copy the dataset's assets folder too",
            )
        channels = self.named("channels", list[tuple[str, str]], "[]")
        states = self.states() if self.row.get("states") else {}
        episode = Episode(
            header=header,
            t=t,
            tracks=StoredItems(self.body_index, self.track),
            _contacts=partial(self.contacts, scene.owner),
            _frames=self.robot,
            meshes=StoredItems(stored, self.mesh),
            channels=StoredItems(channels, self.channel),
            states=states,
            attachments=StoredItems(attachments, lambda name: self.attachment(attachments[name])),
            path=self.file,
        )
        if self.checked:
            self.seal.check(header)
            vars(episode)["_vouched"] = self.seal.content_hash
        return episode

    def few(self, shapes: pa.Table) -> pa.Table:
        """Return the rows of geoms. Raises TraceError for more than contacts can tell apart."""
        if len(shapes) > MOST_GEOMS:
            raise TraceError(self.where, f"{len(shapes):,} geoms.", f"{MOST_GEOMS:,} at most")
        return shapes

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

    def table(self, name: str) -> StoredTable:
        file = inside_dataset(self.dataset, name, f"{self.row['file']}.parquet", self.where)
        table = StoredTable(file, name)
        if self.checked and name in DIGESTED_TABLES and self.seal.open:
            table.compare(self.index, self.seal)
        return table

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

    def time(self) -> NDArray[np.float64]:
        frame, t = self.frames_table.blocks((_FRAME, _TIME), self.index)
        self.in_order(frame[:, 0], "frames", self.length)
        return t[:, 0]

    def track(self, body: str) -> Track:
        return StoredTrack(lambda columns: self.track_columns(body, columns))

    def track_columns(self, body: str, columns: tuple[str, ...]) -> dict[str, NDArray[np.float32]]:
        source = self.bodies_table
        if self.whole and not self._in_order:
            source.read_ahead(self.index)
        blocks = tuple(_TRACK[column] for column in columns)
        first = () if body in self._in_order else (_FRAME,)
        arrays = source.blocks((*first, *blocks), self.index, (body,))
        loaded: dict[str, NDArray[np.float32]] = {}
        for column, values in zip(columns, arrays[len(first) :], strict=True):
            if len(values) == 0:
                raise TraceError(self.where, f"body {body!r} has no poses in {source.path}")
            if body not in self._in_order:
                rows = 1 if len(values) == 1 else self.length
                self.in_order(arrays[0][:, 0], f"body {body!r}", rows)
                self._in_order.add(body)
            if self.checked:
                self.demand(check_track_column(column, values, body, self.length, self.where))
            loaded[column] = values
        return loaded

    def contacts(self, geom_owner: NDArray[np.int16]) -> ContactTable:
        table = self.table("contacts")
        if self.whole:
            table.read_ahead(self.index)
        elif self.row["contacts"] <= FEW_CONTACTS:
            table.read_ahead(self.index, MOSTLY_READ)
        return StoredContacts(
            Source(
                table,
                self.index,
                self.row["contacts"],
                self.length,
                self.body_index,
                geom_owner,
                self.checked,
                self.where,
                self.whole,
            )
        )

    def robot(self) -> RobotFrames:
        source = self.frames_table
        table = source.rows(tuple(ROBOT_COLUMNS.values()), self.index)
        frames = RobotFrames(
            *(source.lists(table, column, np.float32) for column in ROBOT_COLUMNS.values())
        )
        self.demand(check_frames(frames, self.length, self.where))
        return frames

    def mesh(self, key: str) -> Mesh:
        name = f"{key}.ply"
        return from_ply(self.asset_bytes(name), key, str(self.asset(name)))

    def channel(self, key: tuple[str, str]) -> NDArray[np.float32]:
        source = self.table("channels")
        table = source.rows(("frame_index", "name", "value"), self.index, key[0])
        own = [name == key[1] for name in table["name"].to_pylist()]
        table = table.filter(pa.array(own, pa.bool_()))  # of no rows too
        frame = source.numbers(table, "frame_index", np.int32)
        self.in_order(frame, f"channel {key[1]!r} of {key[0]!r}", self.length)
        values: NDArray[np.float32] = source.numbers(table, "value", np.float32)
        self.demand(check_finite(values, f"channel {key[1]!r} of {key[0]!r}", self.where))
        return values

    def states(self) -> StoredItems[int, NDArray[np.float64]]:
        source = self.table("states")
        column = source.rows(("frame_index",), self.index)
        frames = source.numbers(column, "frame_index", np.int64).tolist()

        def load(frame: int) -> NDArray[np.float64]:
            table = source.rows(("state",), self.index)
            row = table.slice(frames.index(frame), 1)
            state: NDArray[np.float64] = source.lists(row, "state", np.float64)[0]
            return state

        return StoredItems(frames, load)


def _recomputed(file: Path, row: Mapping[str, Any]) -> str:
    """The content hash, of everything. Raises TraceError for the first thing that is wrong with it."""
    stored = _StoredEpisode(file, row, checked=False, whole=True)
    return computed(stored.episode())
