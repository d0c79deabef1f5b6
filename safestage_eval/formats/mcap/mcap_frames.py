"""Motion, joints and commands in an MCAP trace: one ``safestage.v1.Frame`` per frame."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.episode.scene_invariants import UNIT_TOLERANCE
from safestage_eval.errors import TraceError
from safestage_eval.formats.frame_buffers import doubled

from .mcap_arrays import copy_frames
from .mcap_chunks import Batch
from .mcap_messages import FRAME, MESSAGES, message_class
from .mcap_metadata import TRACK_COLUMNS

ROBOT_FIELDS = ("joint_position", "joint_velocity", "joint_torque", "action", "gripper")

F32 = NDArray[np.float32]

_FRAMES = 1 << 13
"""Frames that there is room for from the start; memory that is not used costs nothing."""

_LENGTH = 2
"""Wire type of values that are preceded by their length."""

_WIDTHS = {1: 8, 5: 4}
"""Wire type → bytes, of values of fixed width."""

_FIELDS = {f.name: f for f in MESSAGES["Frame"][1]}


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


def _room(width: int) -> int:
    """Frames that there is room for from the start, of so many bytes each."""
    return max(1, min(_FRAMES, (1 << 28) // max(1, width)))


class FrameRows:
    """Collects the messages of all frames as they are read, and makes columns of them.

    Of messages that are laid out alike the numbers are copied as they stand; from the first on that
    is not, all are decoded one by one, which other writers may make necessary.

    Attributes:
        count: messages taken.
        sound: for sure, all numbers of bodies are finite and all orientations of unit norm.
    """

    def __init__(self) -> None:
        self.count = 0
        self.sound = True
        self._like: _Layout | None = None
        self._values = np.zeros((0, 0), np.uint8)
        self._other: list[bytes] | None = None

    def take(self, batch: Batch) -> None:
        """Keep the values of some more messages."""
        if not self.count:
            begin, end = batch.places[0].tolist()
            self._like = _Layout.of(batch.raw[begin:end])
            if self._like is None:
                self._other = []
            else:
                self._values = np.empty((_room(self._like.width), self._like.width), np.uint8)
        end = self.count + len(batch)
        if self._like is not None and self._other is None:
            while end > len(self._values):
                self._values = doubled(self._values)
            values = self._values[self.count : end]
            if self._like.copy(batch, values):
                self.sound = self.sound and self._like.is_sound(values)
            else:
                self._other = self._like.messages(self._values[: self.count])
                self._values = np.zeros((0, 0), np.uint8)
        if self._other is not None:
            self.sound = False
            self._other += batch.messages()
        self.count = end

    def columns(
        self, count: int, where: str
    ) -> tuple[dict[str, F32], NDArray[np.uint64], NDArray[np.float64]]:
        """Return name → (T, width) of every packed field, indices (T,) and times (T,) s of the first messages.

        Raises:
            TraceError: there is none, or one is no frame like the others.
        """
        if not count:
            raise TraceError(where, f"no frames: there is no message on {FRAME}")
        if self._like is None or self._other is not None:
            return _decoded((self._other or [])[:count], where)
        columns = self._like.columns(self._values[:count])
        packed = {name: columns[name] for name, f in _FIELDS.items() if f.type == "float*"}
        return packed, columns["frame_index"][:, 0], columns["time"][:, 0].copy()


class _Layout:
    """Where the fields of a message are, and the bytes between them, which all must share.

    Attributes:
        width: bytes of a row of values: the two numbers of 8 bytes, then the packed ones.
    """

    def __init__(self, message: NDArray[np.uint8], places: dict[int, tuple[int, int]]) -> None:
        self._first = message.copy()
        self._moves: dict[str, tuple[int, int, int]] = {}
        between, self.width = np.ones(len(message), bool), 0
        for name, f in _FIELDS.items():
            offset, length = places.get(f.number, (0, 0))
            self._moves[name] = offset, length, self.width
            self.width += length
        for offset, length in places.values():
            between[offset : offset + length] = False
        self._between = np.flatnonzero(between)
        begins = {name: to // 4 for name, (_, _, to) in self._moves.items()}
        turns = begins["body_orientation"]
        count = self._moves["body_orientation"][1] // 16 * 4  # what is left over tells by its width
        last = begins["joint_position"]
        self._parts = begins["body_position"], last, turns, turns + count

    @classmethod
    def of(cls, message: NDArray[np.uint8]) -> _Layout | None:
        """Return the layout of a message; None where its fields have to be decoded."""
        try:
            places = field_places(message.tobytes())
        except ValueError:
            return None
        numbers = [f.number for f in _FIELDS.values() if f.type in ("fixed64", "double")]
        packed = [f.number for f in _FIELDS.values() if f.type == "float*"]
        if [places.get(n, (0, 0))[1] for n in numbers] != [8] * len(numbers):
            return None
        if any(places[n][1] % 4 for n in packed if n in places):
            return None
        return cls(message, places)

    def copy(self, batch: Batch, values: NDArray[np.uint8]) -> bool:
        """Copy the fields of messages, side by side, into (M, width).

        Returns False where one is laid out in another way.
        """
        return copy_frames(
            batch.raw, batch.places, self._first, self._between, self._moves.values(), values
        )

    def is_sound(self, values: NDArray[np.uint8]) -> bool:
        """True if all numbers of bodies are finite for sure, and all orientations of unit norm."""
        begin, end, turn, stop = self._parts
        numbers = values.view(np.float32)
        with np.errstate(all="ignore"):
            w, x, y, z = np.moveaxis(np.square(numbers[:, turn:stop]).reshape(-1, 4), 1, 0)
            off = np.abs(w + x + y + z - 1).max(initial=0)
            return bool(np.isfinite(numbers[:, begin:end].sum()) and off < UNIT_TOLERANCE)

    def columns(self, values: NDArray[np.uint8]) -> dict[str, NDArray[Any]]:
        """Return name → (N, numbers), views of (N, width)."""
        kinds = {"fixed64": "<u8", "double": "<f8", "float*": "<f4"}
        return {
            name: values[:, to : to + length].view(kinds[_FIELDS[name].type])
            for name, (_, length, to) in self._moves.items()
        }

    def messages(self, values: NDArray[np.uint8]) -> list[bytes]:
        """Restore the messages from their values."""
        rows = np.tile(self._first, (len(values), 1))
        for offset, length, to in self._moves.values():
            rows[:, offset : offset + length] = values[:, to : to + length]
        return [row.tobytes() for row in rows]


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


def _decoded(
    messages: list[bytes], where: str
) -> tuple[dict[str, F32], NDArray[np.uint64], NDArray[np.float64]]:
    """Decode messages one by one; returns as ``FrameRows.columns``."""
    from google.protobuf.message import DecodeError

    frame = message_class("Frame")()
    packed: dict[str, list[Any]] = {n: [] for n, f in _FIELDS.items() if f.type == "float*"}
    index, t = [], []
    for n, message in enumerate(messages):
        try:
            frame.ParseFromString(message)
        except DecodeError as error:
            raise TraceError(where, f"frame {n} is no safestage.v1.Frame: {error}") from None
        index.append(frame.frame_index)
        t.append(frame.time)
        for name, rows in packed.items():
            rows.append(np.array(getattr(frame, name), np.float32))
    for name, rows in packed.items():
        widths = {len(row) for row in rows}
        if len(widths) > 1:
            raise TraceError(
                where, f"{name} has {sorted(widths)} values; every frame must have as many"
            )
    columns = {name: np.stack(rows) for name, rows in packed.items()}
    return columns, np.array(index, np.uint64), np.array(t, np.float64)
