"""An episode as Arrow tables, one for each table of a dataset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from safestage_eval.episode import ContactTable, Episode

from .arrow_tables import CONTACT_VECTORS, ROBOT_COLUMNS, XYZ, schema
from .episode_row import encode, to_geometry

TRACK_COLUMNS = ("position", "orientation", "linear_velocity", "angular_velocity")


def episode_tables(episode: Episode, index: int) -> dict[str, pa.Table]:
    """Return table name → its rows for an episode.

    The optional tables ``channels`` and ``states`` are there only when the episode has any.

    Raises:
        TraceError: a column that is looked at for the first time is damaged.
    """
    tables = {
        "bodies": _bodies(episode, index),
        "contacts": _contacts(episode, index),
        "frames": _frames(episode, index),
        "geometry": as_rows("geometry", to_geometry(episode.header, index)),
    }
    if episode.channels:
        tables["channels"] = _channels(episode, index)
    if episode.states:
        tables["states"] = _states(episode, index)
    return tables


def episode_entry(
    episode: Episode, index: int, file: str, attachments: Mapping[str, str]
) -> dict[str, Any]:
    """Return what the episode's row of ``meta/episodes`` has beside the header (``to_row``).

    ``attachments`` maps names to files in ``assets``.
    """
    name = episode.header.episode_id
    return {
        "episode_index": index,
        "file": file,
        "length": len(episode),
        "contacts": len(episode.contacts),
        "channels": encode([list(key) for key in episode.channels], name),
        "states": len(episode.states),
        "attachments": encode(dict(attachments), name),
        "content_hash": episode.content_hash,
    }


def as_rows(table: str, rows: list[dict[str, Any]]) -> pa.Table:
    """Return records as an Arrow table with the columns of ``table``."""
    return pa.Table.from_pylist(rows, schema(table))


def _table(table: str, columns: Mapping[str, Any]) -> pa.Table:
    return pa.table([columns[name] for name in schema(table).names], schema(table))


def _repeated(words: list[str], rows: list[int]) -> pa.DictionaryArray:
    """Each word as often as it has rows."""
    codes = np.repeat(np.arange(len(words), dtype=np.int16), rows)
    return pa.DictionaryArray.from_arrays(codes, pa.array(words, pa.string()))


def _axes(name: str, values: NDArray[np.float32], axes: tuple[str, ...]) -> dict[str, Any]:
    return {f"{name}.{a}": np.ascontiguousarray(values[:, i]) for i, a in enumerate(axes)}


def _bodies(episode: Episode, index: int) -> pa.Table:
    """Moving bodies first, and the rows of each body together."""
    bodies = sorted(episode.header.bodies, key=lambda body: not body.movable)
    tracks = [episode.tracks[body.name] for body in bodies]
    rows = [len(track) for track in tracks]
    columns: dict[str, Any] = {
        "episode_index": np.full(sum(rows), index, np.int32),
        "frame_index": np.concatenate([np.arange(n, dtype=np.int32) for n in (0, *rows)]),
        "body": _repeated([body.name for body in bodies], rows),
    }
    for name in TRACK_COLUMNS:
        axes = ("w", *XYZ) if name == "orientation" else XYZ
        none = np.zeros((0, len(axes)), np.float32)
        columns |= _axes(name, np.concatenate([none, *(getattr(t, name) for t in tracks)]), axes)
    return _table("bodies", columns)


def _contacts(episode: Episode, index: int) -> pa.Table:
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
    return _table("contacts", columns)


def slots(contacts: ContactTable) -> NDArray[np.int16]:
    """Return the (C,) number of each contact within its frame and pair, in the table's order."""
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


def _channels(episode: Episode, index: int) -> pa.Table:
    keys, values = list(episode.channels), list(episode.channels.values())
    rows = [len(one) for one in values]
    return _table(
        "channels",
        {
            "episode_index": np.full(sum(rows), index, np.int32),
            "frame_index": np.concatenate([np.arange(n, dtype=np.int32) for n in rows]),
            "body": _repeated([body for body, _ in keys], rows),
            "name": _repeated([name for _, name in keys], rows),
            "value": np.concatenate(values),
        },
    )


def _states(episode: Episode, index: int) -> pa.Table:
    return as_rows(
        "states",
        [
            {"episode_index": index, "frame_index": frame, "state": state}
            for frame, state in sorted(episode.states.items())
        ],
    )
