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
from safestage_eval.formats.contact_points import POINT, table_points

from .mcap_arrays import Batch, find_points

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
_DATA = bytes([6 << 3 | 2])
"""Tag before the points, the last field of a PointCloud: its number, and that a length follows."""


def empty_cloud() -> PointCloud:
    """Return a point cloud without time and data, whose points are laid out as POINT."""
    cloud = PointCloud(frame_id="world", point_stride=POINT.itemsize)
    cloud.pose.orientation.w = 1
    offset = 0
    for name in FIELDS:
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


class CloudPoints:
    """Collects the points of the point clouds of all frames as they are read.

    Attributes:
        count: messages taken.
    """

    def __init__(self, where: str) -> None:
        self.count = 0
        self._where = where
        # ours: a stamp, then always the same bytes, then the points
        own = empty_cloud().SerializeToString(deterministic=True) + _DATA
        self._own = np.frombuffer(own, np.uint8)
        self._points: list[bytes] = []
        self._counts: list[int] = []

    def take(self, batch: Batch) -> None:
        """Keep the points of some more messages.

        Raises:
            TraceError: a message is no point cloud, or lacks a field of contacts.
        """
        places = find_points(batch.raw, batch.places, self._own, POINT.itemsize)
        if places is None:  # of writers that lay points out in another way
            points = [_decoded(message, f"the contacts of frame {n}", self._where).tobytes()
                      for n, message in enumerate(batch.messages(), self.count)]  # fmt: skip
        else:
            points = Batch(batch.raw, places).messages()
        self._points += points
        self._counts += [len(data) // POINT.itemsize for data in points]
        self.count += len(batch)

    def points(self, frames: int) -> tuple[NDArray[Any], NDArray[np.int64]]:
        """Return the (C,) POINT of the first frames, and the (T,) number of points in each."""
        points = np.frombuffer(b"".join(self._points[:frames]), POINT)
        return points, np.array(self._counts[:frames], np.int64)


def _decoded(message: bytes, name_: str, where: str) -> NDArray[Any]:
    """Return the (C,) POINT of one cloud. Raises TraceError when it is no table of contacts."""
    try:
        cloud = PointCloud.FromString(message)
    except DecodeError as error:
        raise TraceError(where, f"{name_} are no point cloud: {error}") from None
    names = [f.name for f in cloud.fields]
    missing = [name for name in FIELDS if name not in names]
    if missing:
        raise TraceError(where, f"{name_} lack the field {missing[0]!r}.", ", ".join(FIELDS))
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
        for name, (column, place) in FIELDS.items():
            target = points[column] if place is None else points[column][:, place]
            target[...] = table[name]
    except (TypeError, ValueError) as error:
        raise TraceError(where, f"{name_} are no table of points: {error}") from None
    return points
