"""Motion, joints and commands in an MCAP trace: one ``safestage.v1.Frame`` per frame."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.episode.scene_invariants import UNIT_TOLERANCE
from safestage_eval.errors import TraceError

from .mcap_arrays import Batch, alike
from .mcap_messages import FRAME, MESSAGES, message_class
from .mcap_metadata import TRACK_COLUMNS

ROBOT_FIELDS = ("joint_position", "joint_velocity", "joint_torque", "action", "gripper")

_LENGTH = 2
"""Wire type of values that are preceded by their length."""

_WIDTHS = {1: 8, 5: 4}
"""Wire type → bytes, of values of fixed width."""

_FIELDS = {f.name: f for f in MESSAGES["Frame"][1]}
_KINDS = {"fixed64": "<u8", "double": "<f8", "float*": "<f4"}

PACKED = tuple(name for name, f in _FIELDS.items() if f.type.endswith("*"))
"""Fields of many values; the others have one in each message."""


def frame_messages(episode: Episode, moving: list[str]) -> Iterator[bytes]:
    """Serialise the ``Frame`` messages of an episode; ``moving``: the bodies that they hold."""
    message = message_class("Frame")
    columns = {
        f"body_{name}": np.concatenate([getattr(episode.tracks[b], name) for b in moving], 1)
        for name in TRACK_COLUMNS
        if moving
    }
    columns |= {name: getattr(episode.frames, name) for name in ROBOT_FIELDS}
    if episode.channels:
        columns["channel"] = np.stack(list(episode.channels.values()), 1)
    columns = {name: values for name, values in columns.items() if values.shape[1]}
    for n, t in enumerate(episode.t.tolist()):
        values = {name: column[n].tolist() for name, column in columns.items()}
        yield message(frame_index=n, time=t, **values).SerializeToString()


class FrameRows:
    """Collects the messages of all frames as they are read, and makes columns of them.

    Of messages that are laid out alike the numbers are copied as they stand, block by block; others, which other
    writers may write, are decoded one by one.

    Attributes:
        count: messages taken.
    """

    def __init__(self, where: str) -> None:
        self.count = 0
        self._where = where
        self._blocks: list[dict[str, NDArray[Any]]] = []

    def take(self, batch: Batch) -> None:
        """Keep the values of some more messages. Raises TraceError for one that is no frame."""
        columns = _copied(batch)
        if columns is None:
            columns = _decoded(batch.messages(), self.count, self._where)
        self._blocks.append(columns)
        self.count += len(batch)

    def columns(self, count: int) -> dict[str, NDArray[Any]]:
        """Return name → (T, width) of every field of the first messages.

        Raises:
            TraceError: there is none, or they differ in the number of values.
        """
        if not count:
            raise TraceError(self._where, f"no frames: there is no message on {FRAME}")
        for name in _FIELDS:
            widths = {block[name].shape[1] for block in self._blocks}
            if len(widths) > 1:
                raise _other_widths(self._where, name, widths)
        return {
            name: np.concatenate([block[name] for block in self._blocks])[:count]
            for name in _FIELDS
        }


def _copied(batch: Batch) -> dict[str, NDArray[Any]] | None:
    """Return name → (N, width) of messages that are laid out like the first one; None where they are not."""
    begin, end = batch.places[0].tolist()
    first = batch.raw[begin:end]
    try:
        places = field_places(first.tobytes())
    except ValueError:
        return None
    for name, field in _FIELDS.items():
        length = places.get(field.number, (0, 0))[1]
        if length % 4 if name in PACKED else length != 8:
            return None
    between = np.ones(len(first), bool)
    for offset, length in places.values():
        between[offset : offset + length] = False
    messages = alike(batch, np.flatnonzero(between))
    if messages is None:
        return None
    columns = {}
    for name, field in _FIELDS.items():
        offset, length = places.get(field.number, (0, 0))
        columns[name] = messages[:, offset : offset + length].view(_KINDS[field.type])
    return columns


def are_sound(columns: dict[str, NDArray[Any]]) -> bool:
    """True if all numbers of bodies are finite for sure, and all orientations of unit norm."""
    turns = columns["body_orientation"]
    with np.errstate(all="ignore"):
        total = sum(float(columns[f"body_{name}"].sum()) for name in TRACK_COLUMNS)
        w, x, y, z = np.moveaxis(
            np.square(turns[:, : turns.shape[1] // 4 * 4]).reshape(-1, 4), 1, 0
        )
        off = np.abs(w + x + y + z - 1).max(initial=0)
        return bool(np.isfinite(total) and off < UNIT_TOLERANCE)


def field_places(message: bytes) -> dict[int, tuple[int, int]]:
    """Return field number → (offset, bytes) of its value in a message of fixed-width and packed fields.

    Wire format: https://protobuf.dev/programming-guides/encoding/

    Raises:
        ValueError: another kind of field, one that comes twice, or a message that is cut off.
    """
    places: dict[int, tuple[int, int]] = {}
    at = 0
    try:
        while at < len(message):
            key, at = _read_varint(message, at)
            if key & 7 == _LENGTH:
                size, at = _read_varint(message, at)
            elif key & 7 in _WIDTHS:
                size = _WIDTHS[key & 7]
            else:
                raise ValueError(f"field {key >> 3} has wire type {key & 7}")
            if key >> 3 in places:
                raise ValueError(f"field {key >> 3} comes twice")
            places[key >> 3] = at, size
            at += size
    except IndexError:
        raise ValueError("the message is cut off") from None
    if at != len(message):
        raise ValueError("the message is cut off")
    return places


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    """Read the integer at a position; return it and the position after it.

    Raises:
        IndexError: it goes on past the end, or beyond 64 bits.
    """
    n, shift = 0, 0
    while shift < 64:
        byte = data[at]
        at += 1
        n |= (byte & 0x7F) << shift
        if byte < 0x80:
            return n, at
        shift += 7
    raise IndexError("an integer of more than 64 bits")


def _decoded(messages: list[bytes], first: int, where: str) -> dict[str, NDArray[Any]]:
    """Decode messages one by one, of which the first has a number; returns as ``_copied``."""
    from google.protobuf.message import DecodeError

    frame = message_class("Frame")()
    rows: dict[str, list[Any]] = {name: [] for name in _FIELDS}
    for n, message in enumerate(messages, first):
        try:
            frame.ParseFromString(message)
        except DecodeError as error:
            raise TraceError(where, f"frame {n} is no safestage.v1.Frame: {error}") from None
        for name, field in _FIELDS.items():
            value = getattr(frame, name)
            rows[name].append(np.array(value if name in PACKED else [value], _KINDS[field.type]))
    for name, some in rows.items():
        widths = {len(row) for row in some}
        if len(widths) > 1:
            raise _other_widths(where, name, widths)
    return {name: np.stack(some) for name, some in rows.items()}


def _other_widths(where: str, name: str, widths: set[int]) -> TraceError:
    return TraceError(where, f"{name} has {sorted(widths)} values; every frame must have as many")
