"""Adding an episode to a Parquet dataset."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from safestage_eval.episode import ContactTable, Episode, Track

from . import dataset_layout as layout
from .arrow_tables import CONTACT_VECTORS, ROBOT_COLUMNS, XYZ, schema, write_options
from .atomic import PART, replacing, sync, write_bytes
from .episode_row import encode, mesh_keys, to_geometry, to_row
from .ply import to_ply

CONTACT_GROUP = 2048
"""Least rows of a row group of contacts; it ends where the pair of bodies changes."""

TRACK_COLUMNS = ("position", "orientation", "linear_velocity", "angular_velocity")


def add_episode(episode: Episode, dataset: Path) -> Path:
    """Write an episode as a new file set of the dataset; returns its ``meta/episodes`` file.

    The folder is made when it is not there. Each file appears whole, the one under
    ``meta/episodes`` last, so no reader ever sees half an episode; several recorders may add to
    the same dataset at once.

    Raises:
        TraceError: the folder is something else, or the header holds a number that is not finite.
    """
    row = to_row(episode.header)
    layout.prepare(dataset)
    for key in mesh_keys(episode.header):
        _add_asset(dataset, f"{key}.ply", to_ply(episode.meshes[key]))
    attachments = {
        name: _add_asset(dataset, sha256(data).hexdigest() + Path(name).suffix, data)
        for name, data in episode.attachments.items()
    }
    with _reserved(dataset) as (index, part):
        file = _file_name(index)
        _write(dataset, "bodies", file, _bodies(episode, index))
        _write(dataset, "contacts", file, _contacts(episode, index))
        _write(dataset, "frames", file, [_frames(episode, index)])
        _write(dataset, "geometry", file, [_rows("geometry", to_geometry(episode.header, index))])
        if episode.channels:
            _write(dataset, "channels", file, _channels(episode, index))
        if episode.states:
            _write(dataset, "states", file, [_states(episode, index)])
        row |= {
            "episode_index": index,
            "file": file,
            "length": len(episode),
            "contacts": len(episode.contacts),
            "channels": encode([list(key) for key in episode.channels], episode.header.episode_id),
            "states": len(episode.states),
            "attachments": encode(attachments, episode.header.episode_id),
            "content_hash": episode.content_hash,
        }
        _write_table(part, "meta/episodes", [_rows("meta/episodes", [row])])
    return dataset / layout.EPISODES / f"{file}.parquet"


def _file_name(index: int) -> str:
    return f"episode-{index:06d}"


@contextmanager
def _reserved(dataset: Path) -> Iterator[tuple[int, Path]]:
    """The next free episode index, and the file that becomes the episode's row in the end.

    That file, under its temporary name, is the reservation: creating it fails when another
    recorder has it. One that was killed leaves it behind, and its index unused.
    """
    folder = dataset / layout.EPISODES
    folder.mkdir(parents=True, exist_ok=True)
    index = max((_highest_index(file) for file in folder.iterdir()), default=-1) + 1
    while True:
        final = folder / f"{_file_name(index)}.parquet"
        part = folder / f".{final.name}{PART}"
        try:
            part.open("xb").close()
        except FileExistsError:
            index += 1
            continue
        if not final.exists():
            break
        part.unlink()
        index += 1
    try:
        yield index, part
        sync(part)
        part.replace(final)
        sync(folder)
    except BaseException:
        part.unlink(missing_ok=True)
        for table in (dataset / name for name in layout.TABLE_FOLDERS):
            (table / final.name).unlink(missing_ok=True)
        raise


def _highest_index(file: Path) -> int:
    """The last episode index that a file of ``meta/episodes`` holds or reserves; −1 for none."""
    if match := re.match(r"\.?episode-(\d+)\.", file.name):
        return int(match[1])
    if file.suffix != ".parquet":
        return -1
    column = pq.read_table(file, columns=["episode_index"])["episode_index"]
    return max(column.to_pylist(), default=-1)


def _add_asset(dataset: Path, name: str, data: bytes) -> str:
    path = dataset / layout.ASSETS / name
    if not path.exists():
        write_bytes(path, data)
    return name


def _write(
    dataset: Path, table: str, file: str, groups: Iterator[pa.Table] | list[pa.Table]
) -> None:
    with replacing(dataset / table / f"{file}.parquet") as part:
        _write_table(part, table, groups)


def _write_table(path: Path, table: str, groups: Iterator[pa.Table] | list[pa.Table]) -> None:
    """One row group per given table; a file without groups has the schema only."""
    with pq.ParquetWriter(path, schema(table), **write_options(table)) as writer:
        for group in groups:
            if len(group):
                writer.write_table(group, row_group_size=len(group))


def _rows(table: str, rows: list[dict[str, Any]]) -> pa.Table:
    return pa.Table.from_pylist(rows, schema(table))


def _table(table: str, columns: Mapping[str, Any]) -> pa.Table:
    return pa.table([columns[name] for name in schema(table).names], schema(table))


def _constant(value: str, rows: int) -> pa.DictionaryArray:
    return pa.DictionaryArray.from_arrays(np.zeros(rows, np.int16), pa.array([value]))


def _axes(name: str, values: NDArray[np.float32], axes: tuple[str, ...]) -> dict[str, Any]:
    return {f"{name}.{a}": np.ascontiguousarray(values[:, i]) for i, a in enumerate(axes)}


def _bodies(episode: Episode, index: int) -> Iterator[pa.Table]:
    for body in episode.header.bodies:
        track: Track = episode.tracks[body.name]
        columns: dict[str, Any] = {
            "episode_index": np.full(len(track), index, np.int32),
            "frame_index": np.arange(len(track), dtype=np.int32),
            "body": _constant(body.name, len(track)),
        }
        for name in TRACK_COLUMNS:
            axes = ("w", *XYZ) if name == "orientation" else XYZ
            columns |= _axes(name, getattr(track, name), axes)
        yield _table("bodies", columns)


def _contacts(episode: Episode, index: int) -> Iterator[pa.Table]:
    contacts = episode.contacts
    slot = slots(contacts)
    order = np.lexsort((contacts.frame, slot, contacts.body2, contacts.body1))
    contacts, slot = contacts.where(order), slot[order]
    names = pa.array([body.name for body in episode.header.bodies], pa.string())
    columns: dict[str, Any] = {
        "episode_index": np.full(len(slot), index, np.int32),
        "frame_index": contacts.frame,
        "slot": slot,
        "body1": pa.DictionaryArray.from_arrays(contacts.body1, names),
        "body2": pa.DictionaryArray.from_arrays(contacts.body2, names),
        "geom1": contacts.geom1,
        "geom2": contacts.geom2,
        "peak_force": contacts.peak_force,
        "depth": contacts.depth,
    }
    for name in CONTACT_VECTORS:
        columns |= _axes(name, getattr(contacts, name), XYZ)
    whole = _table("contacts", columns)
    new_pair = np.diff(contacts.body1, prepend=-1) != 0
    new_pair |= np.diff(contacts.body2, prepend=-1) != 0
    begin = 0
    for end in (*np.flatnonzero(new_pair).tolist(), len(slot)):
        if end - begin >= CONTACT_GROUP or end == len(slot):
            yield whole.slice(begin, end - begin)
            begin = end


def slots(contacts: ContactTable) -> NDArray[np.int16]:
    """(C,) number of each contact within its frame and pair, in the table's order."""
    if not len(contacts):
        return np.zeros(0, np.int16)
    first = np.ones(len(contacts), bool)
    first[1:] = contacts.frame[1:] != contacts.frame[:-1]
    first[1:] |= contacts.body1[1:] != contacts.body1[:-1]
    first[1:] |= contacts.body2[1:] != contacts.body2[:-1]
    rows = np.arange(len(contacts))
    return (rows - np.maximum.accumulate(np.where(first, rows, 0))).astype(np.int16)


def _lists(values: NDArray[Any]) -> pa.ListArray:
    rows, width = values.shape
    offsets = np.arange(rows + 1, dtype=np.int32) * width
    return pa.ListArray.from_arrays(offsets, np.ascontiguousarray(values).ravel())


def _frames(episode: Episode, index: int) -> pa.Table:
    columns: dict[str, Any] = {
        "episode_index": np.full(len(episode), index, np.int32),
        "frame_index": np.arange(len(episode), dtype=np.int32),
        "timestamp": episode.t,
    }
    for attribute, column in ROBOT_COLUMNS.items():
        columns[column] = _lists(getattr(episode.frames, attribute))
    return _table("frames", columns)


def _channels(episode: Episode, index: int) -> Iterator[pa.Table]:
    for (body, name), values in episode.channels.items():
        rows = len(values)
        yield _table(
            "channels",
            {
                "episode_index": np.full(rows, index, np.int32),
                "frame_index": np.arange(rows, dtype=np.int32),
                "body": _constant(body, rows),
                "name": _constant(name, rows),
                "value": np.ascontiguousarray(values),
            },
        )


def _states(episode: Episode, index: int) -> pa.Table:
    return _rows(
        "states",
        [
            {"episode_index": index, "frame_index": frame, "state": state}
            for frame, state in sorted(episode.states.items())
        ],
    )
