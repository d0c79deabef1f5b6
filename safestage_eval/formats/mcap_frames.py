"""Motion, joints and commands in an MCAP trace: one ``safestage.v1.Frame`` per frame."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.errors import TraceError

from . import wire
from .mcap_messages import FRAME, MESSAGES, message_class
from .mcap_metadata import TRACK_COLUMNS

ROBOT_FIELDS = ("joint_position", "joint_velocity", "joint_torque", "action", "gripper")

F32 = NDArray[np.float32]

_FIELDS = {f.name: f for f in MESSAGES["Frame"][1]}


def frame_messages(episode: Episode, moving: list[str]) -> Iterator[bytes]:
    """Serialised ``Frame`` messages, all laid out alike, assembled column by column."""
    frames = len(episode)
    blocks = [
        wire.tag(1, wire.FIXED64),
        np.arange(frames, dtype="<u8"),
        wire.tag(2, wire.FIXED64),
        episode.t.astype("<f8"),
    ]
    columns: list[NDArray[np.float32]] = []
    for name in TRACK_COLUMNS:
        parts = [getattr(episode.tracks[body], name) for body in moving]
        columns.append(np.concatenate(parts, 1) if parts else np.zeros((frames, 0), np.float32))
    columns += [getattr(episode.frames, name) for name in ROBOT_FIELDS]
    channels = list(episode.channels.values())
    columns.append(np.stack(channels, 1) if channels else np.zeros((frames, 0), np.float32))
    for number, column in enumerate(columns, 3):
        if column.shape[1]:
            blocks.append(wire.tag(number, wire.LENGTH) + wire.varint(4 * column.shape[1]))
            blocks.append(column.astype("<f4"))
    rows = [
        np.broadcast_to(np.frombuffer(block, np.uint8), (frames, len(block)))
        if isinstance(block, bytes)
        else np.ascontiguousarray(block).view(np.uint8).reshape(frames, -1)
        for block in blocks
    ]
    data = np.concatenate(rows, 1)
    size, whole = data.shape[1], data.tobytes()
    return (whole[n * size : (n + 1) * size] for n in range(frames))


def read_frames(
    messages: list[memoryview], where: str
) -> tuple[dict[str, F32], NDArray[np.uint64], NDArray[np.float64]]:
    """Name → (T, width) of every packed field, frame indices (T,) and times (T,) s."""
    if not messages:
        raise TraceError(where, f"no frames: there is no message on {FRAME}")
    try:
        places = wire.layout(bytes(messages[0]))
    except ValueError:
        places = {}
    size = len(messages[0])
    alike = {1, 2} <= places.keys() and all(len(m) == size for m in messages)
    if alike:
        rows = np.frombuffer(b"".join(messages), np.uint8).reshape(-1, size)
        between = np.ones(size, bool)
        for offset, length in places.values():
            between[offset : offset + length] = False
        alike = bool((rows[:, between] == rows[0, between]).all())
    if not alike:
        return _decoded(messages, where)

    def column(name: str, dtype: str) -> NDArray[Any]:
        offset, length = places.get(_FIELDS[name].number, (0, 0))
        return np.ascontiguousarray(rows[:, offset : offset + length]).view(dtype)

    packed = {name: column(name, "<f4") for name, f in _FIELDS.items() if f.type == "float*"}
    return packed, column("frame_index", "<u8")[:, 0], column("time", "<f8")[:, 0]


def _decoded(
    messages: list[memoryview], where: str
) -> tuple[dict[str, F32], NDArray[np.uint64], NDArray[np.float64]]:
    """The same, message by message: for writers that lay fields out in another way."""
    from google.protobuf.message import DecodeError

    frame = message_class("Frame")()
    packed: dict[str, list[Any]] = {n: [] for n, f in _FIELDS.items() if f.type == "float*"}
    index, t = [], []
    for n, message in enumerate(messages):
        try:
            frame.ParseFromString(bytes(message))
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
