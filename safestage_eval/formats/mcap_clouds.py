"""Contacts in an MCAP trace: one ``foxglove.PointCloud`` per frame."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from google.protobuf.message import DecodeError
from numpy.typing import NDArray

from safestage_eval.episode import ContactTable
from safestage_eval.errors import TraceError

from . import wire
from .contact_points import POINT

FIELDS = {
    **{name: ("position", i) for i, name in enumerate("xyz")},
    **{f"n{axis}": ("normal", i) for i, axis in enumerate("xyz")},
    **{f"f{axis}": ("force", i) for i, axis in enumerate("xyz")},
    "peak_force": ("peak_force", None),
    "depth": ("depth", None),
    "geom1": ("geom1", None),
    "geom2": ("geom2", None),
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
_DATA = wire.tag(6, wire.LENGTH)
"""What stands before the points, the last field of a PointCloud."""


def empty_cloud() -> PointCloud:
    """A point cloud without time and data, whose points are laid out as POINT."""
    cloud = PointCloud(frame_id="world", point_stride=POINT.itemsize)
    cloud.pose.orientation.w = 1
    offset = 0
    for name in FIELDS:
        whole = name.startswith("geom")
        kind = PackedElementField.UINT16 if whole else PackedElementField.FLOAT32
        cloud.fields.add(name=name, offset=offset, type=kind)
        offset += 2 if whole else 4
    return cloud


def cloud_messages(contacts: ContactTable, times: list[int]) -> Iterator[bytes]:
    """Serialised point clouds, one per frame; ``times`` (T,) ns, their log times."""
    points = np.empty(len(contacts), POINT)
    for name in POINT.names or ():
        points[name] = getattr(contacts, name)
    ends = np.searchsorted(contacts.frame, np.arange(len(times) + 1)) * POINT.itemsize
    whole, fixed = points.tobytes(), empty_cloud().SerializeToString(deterministic=True)
    for time, begin, end in zip(times, ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        yield wire.stamp(1, time) + fixed + wire.field(6, whole[begin:end])


def read_clouds(messages: list[memoryview], where: str) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """Points (C,) of all frames as POINT, and how many each frame has (T,).

    Raises:
        TraceError: a message is no point cloud, or lacks a field of contacts.
    """
    # ours: a stamp, then always the same bytes, then the points
    own = empty_cloud().SerializeToString(deterministic=True) + _DATA
    parts = []
    for n, message in enumerate(messages):
        head = bytes(message[: len(own) + 32])
        begin = 2 + head[1] if len(head) > 1 else 0
        if not head.startswith(own, begin):
            return _decoded(messages, where)
        size, at = wire.read_varint(head, begin + len(own))
        if at + size != len(message) or size % POINT.itemsize:
            raise TraceError(where, f"the contacts of frame {n} are cut off")
        parts.append(message[at:])
    counts = np.array([len(part) for part in parts], np.int64) // POINT.itemsize
    return np.frombuffer(b"".join(parts), POINT), counts


def _decoded(messages: list[memoryview], where: str) -> tuple[NDArray[Any], NDArray[np.int64]]:
    """The same, message by message: for writers that lay points out in another way."""
    parts = []
    for n, message in enumerate(messages):
        try:
            cloud = PointCloud.FromString(bytes(message))
        except DecodeError as error:
            raise TraceError(
                where, f"the contacts of frame {n} are no point cloud: {error}"
            ) from None
        layout = np.dtype(
            {
                "names": [f.name for f in cloud.fields],
                "formats": [_NUMBERS.get(f.type, "V0") for f in cloud.fields],
                "offsets": [f.offset for f in cloud.fields],
                "itemsize": cloud.point_stride,
            }
        )
        missing = [name for name in FIELDS if name not in (layout.names or ())]
        if missing:
            raise TraceError(
                where,
                f"the contacts of frame {n} lack the field {missing[0]!r}.",
                ", ".join(FIELDS),
            )
        given = np.frombuffer(cloud.data, layout)
        points = np.empty(len(given), POINT)
        for name, (column, place) in FIELDS.items():
            target = points[column] if place is None else points[column][:, place]
            target[...] = given[name]
        parts.append(points)
    counts = np.array([len(part) for part in parts], np.int64)
    return np.concatenate(parts), counts
