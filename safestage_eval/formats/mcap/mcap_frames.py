"""What is recorded in each frame of an MCAP trace, as messages and back.

Motion, joints and commands are one ``safestage.v1.Frame`` per frame, contacts one ``foxglove.PointCloud``. Of messages
laid out as this project writes them the numbers are copied as they stand, block by block; others are decoded one by one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from safestage_eval.episode import ContactTable, Episode
from safestage_eval.errors import TraceError
from safestage_eval.formats.contact_points import POINT, table_points

from .mcap_messages import FRAME, MESSAGES, message_class
from .mcap_metadata import TRACK_COLUMNS
from .mcap_records import Batch

ROBOT_FIELDS = ("joint_position", "joint_velocity", "joint_torque", "action", "gripper")

_FIELDS = {f.name: f for f in MESSAGES["Frame"][1]}
_KINDS: dict[str, np.dtype[Any]] = {
    "fixed64": np.dtype("<u8"),
    "double": np.dtype("<f8"),
    "float*": np.dtype("<f4"),
}
PACKED = tuple(name for name, f in _FIELDS.items() if f.type.endswith("*"))
"""Fields of many values; the others have one in each message."""

CLOUD_FIELDS = {
    **{name: ("position", i) for i, name in enumerate("xyz")},
    **{f"n{axis}": ("normal", i) for i, axis in enumerate("xyz")},
    **{f"f{axis}": ("force", i) for i, axis in enumerate("xyz")},
    **{name: (name, None) for name in ("peak_force", "depth", "geom1", "geom2")},
}
"""Field of the point cloud → field of POINT and its place in there."""

_NUMBERS = {
    PackedElementField.UINT8: "<u1",
    PackedElementField.INT8: "<i1",
    PackedElementField.UINT16: "<u2",
    PackedElementField.INT16: "<i2",
    PackedElementField.UINT32: "<u4",
    PackedElementField.INT32: "<i4",
    PackedElementField.FLOAT32: "<f4",
    PackedElementField.FLOAT64: "<f8",
}

_CLOUD_DATA = bytes([6 << 3 | 2])
"""Tag before the points, the last field of a PointCloud: its number, and that a length follows."""


# ------------------------------------------------------------------ writing


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


def empty_cloud() -> PointCloud:
    """Return a point cloud without time and data, whose points are laid out as POINT."""
    cloud = PointCloud(frame_id="world", point_stride=POINT.itemsize)
    cloud.pose.orientation.w = 1
    offset = 0
    for name in CLOUD_FIELDS:
        whole = name.startswith("geom")
        kind = PackedElementField.UINT16 if whole else PackedElementField.FLOAT32
        cloud.fields.add(name=name, offset=offset, type=kind)
        offset += 2 if whole else 4
    return cloud


def cloud_messages(
    contacts: ContactTable, times: list[int], *, placed: bool = False
) -> Iterator[bytes]:
    """Serialise point clouds, one per frame.

    Args:
        contacts: of the episode.
        times: (T,) ns, their log times.
        placed: say that the clouds' place is the origin, too. Left out it means the same, but not to Rerun,
            which then writes recordings that it refuses itself.
    """
    ends = np.searchsorted(contacts.frame, np.arange(len(times) + 1)) * POINT.itemsize
    points, cloud = table_points(contacts).tobytes(), empty_cloud()
    if placed:
        cloud.pose.position.SetInParent()
    for time, begin, end in zip(times, ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        cloud.timestamp.FromNanoseconds(time)
        cloud.data = points[begin:end]
        yield cloud.SerializeToString(deterministic=True)


# ------------------------------------------------------------------ reading


def frame_columns(batches: Sequence[Batch], count: int, where: str) -> dict[str, NDArray[Any]]:
    """Return name → (T, width) of every field of the first messages.

    Raises:
        TraceError: there is none, one is no frame, or they differ in the number of values.
    """
    if not count:
        raise TraceError(where, f"no frames: there is no message on {FRAME}")
    blocks, first = [], 0
    for batch in batches:
        copied = _copied_frames(batch)
        blocks.append(copied or _decoded_frames(batch.messages(), first, where))
        first += len(batch.places)
    columns = {}
    for name in _FIELDS:
        parts = [block[name] for block in blocks]
        _demand_width({part.shape[1] for part in parts}, name, where)
        columns[name] = np.concatenate(parts)[:count]
    return columns


def _demand_width(widths: set[int], name: str, where: str) -> None:
    if len(widths) > 1:
        what = f"{name} has {sorted(widths)} values; every frame must have as many"
        raise TraceError(where, what)


def _copied_frames(batch: Batch) -> dict[str, NDArray[Any]] | None:
    """Name → (M, width) of messages that are laid out as ours; None where they are not.

    Wire format: https://protobuf.dev/programming-guides/encoding/
    """
    begin, end = batch.places[0].tolist()
    frame = message_class("Frame")()
    try:
        frame.ParseFromString(batch.raw[begin:end].tobytes())
    except DecodeError:
        return None
    own, places = bytearray(), {}
    for name, field in _FIELDS.items():
        kind, width = _KINDS[field.type], len(getattr(frame, name)) if name in PACKED else 1
        if width:
            own += bytes([field.number << 3 | (2 if name in PACKED else 1)])
            own += _varint(width * kind.itemsize) if name in PACKED else b""
        places[name] = len(own), len(own) + width * kind.itemsize
        own += bytes(width * kind.itemsize)
    if (batch.places[:, 1] - batch.places[:, 0] != len(own)).any():
        return None
    messages = batch.bytes_at(batch.places[:, 0], len(own))
    between = np.ones(len(own), bool)
    for begin, end in places.values():
        between[begin:end] = False
    if (messages[:, between] != np.frombuffer(own, np.uint8)[between]).any():
        return None
    return {n: messages[:, a:b].view(_KINDS[_FIELDS[n].type]) for n, (a, b) in places.items()}


def _varint(number: int) -> bytes:
    """An integer as protobuf writes it: seven bits in a byte, the lowest ones first."""
    digits = bytearray()
    while number > 0x7F:
        digits.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*digits, number])


def _decoded_frames(messages: list[bytes], first: int, where: str) -> dict[str, NDArray[Any]]:
    """Decode messages one by one, of which the first has a number."""
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
        _demand_width({len(row) for row in some}, name, where)
    return {name: np.stack(some) for name, some in rows.items()}


def cloud_points(
    batches: Sequence[Batch], count: int, where: str
) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Return the (C,) POINT of the first clouds, and how many (T,) are of each.

    Raises:
        TraceError: a message is no point cloud, or lacks a field of contacts.
    """
    # ours: a stamp, then always the same bytes, then the points
    own = np.frombuffer(empty_cloud().SerializeToString(deterministic=True) + _CLOUD_DATA, np.uint8)
    parts: list[bytes] = []
    for batch in batches:
        points = _copied_points(batch, own)
        parts += (
            [_decoded_points(m, n, where) for n, m in enumerate(batch.messages(), len(parts))]
            if points is None
            else points.messages()
        )
    counts = [len(part) // POINT.itemsize for part in parts[:count]]
    return np.frombuffer(b"".join(parts[:count]), POINT), np.array(counts, np.int64)


def _copied_points(batch: Batch, own: NDArray[np.uint8]) -> Batch | None:
    """Where the points of clouds are that are laid out as ours; None where they are not."""
    at, end = batch.places.T.copy()
    if (end - at < len(own) + 3).any():
        return None
    at += 2 + batch.raw[at + 1].astype(np.int64)  # after the stamp
    if (at + len(own) >= end).any() or (batch.bytes_at(at, len(own)) != own).any():
        return None
    at += len(own)
    left = end - at
    digits = 1 + sum((left - n >= 128**n).astype(np.int64) for n in range(1, 5))
    stated = np.zeros(len(at), np.int64)
    for n in range(5):
        digit = batch.raw[np.minimum(at + n, end - 1)].astype(np.int64) & 0x7F
        stated += np.where(n < digits, digit, 0) << 7 * n
    at += digits
    if (at + stated != end).any() or (stated % POINT.itemsize).any():
        return None
    return Batch(batch.raw, np.stack([at, end], 1))


def _decoded_points(message: bytes, frame: int, where: str) -> bytes:
    """The POINTs of one cloud. Raises TraceError when it is no table of contacts."""
    whose = f"the contacts of frame {frame}"
    try:
        cloud = PointCloud.FromString(message)
    except DecodeError as error:
        raise TraceError(where, f"{whose} are no point cloud: {error}") from None
    names = [f.name for f in cloud.fields]
    if missing := [name for name in CLOUD_FIELDS if name not in names]:
        what = f"{whose} lack the field {missing[0]!r}."
        raise TraceError(where, what, ", ".join(CLOUD_FIELDS))
    try:
        layout = np.dtype(
            {
                "names": names,
                "formats": [_NUMBERS.get(f.type, "V0") for f in cloud.fields],
                "offsets": [f.offset for f in cloud.fields],
                "itemsize": cloud.point_stride,
            }
        )
        table = np.frombuffer(cloud.data, layout)
        points = np.empty(len(table), POINT)
        for name, (column, place) in CLOUD_FIELDS.items():
            target = points[column] if place is None else points[column][:, place]
            target[...] = table[name]
    except (TypeError, ValueError) as error:
        raise TraceError(where, f"{whose} are no table of points: {error}") from None
    return points.tobytes()


def full_states(
    batches: Sequence[Batch], frames: int, where: str
) -> dict[int, NDArray[np.float64]]:
    """Return frame → state of the first frames. Raises TraceError for a message that is damaged."""
    states = {}
    for message in (message for batch in batches for message in batch.messages()):
        try:
            state = message_class("State").FromString(message)
        except DecodeError as error:
            raise TraceError(where, f"a state cannot be read: {error}.") from None
        if state.frame_index < frames:
            states[int(state.frame_index)] = np.array(state.state, np.float64)
    return states
