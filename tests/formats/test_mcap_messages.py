"""Frames and contacts that are copied in bulk are those that protobuf decodes one by one."""

from itertools import pairwise

import numpy as np
import pytest
from foreign_mcap import foreign_cloud
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.errors import TraceError
from safestage_eval.formats.contact_points import POINT
from safestage_eval.formats.mcap.mcap_frames import (
    PACKED,
    cloud_points,
    empty_cloud,
    frame_columns,
)
from safestage_eval.formats.mcap.mcap_messages import message_class
from safestage_eval.formats.mcap.mcap_records import Batch


def batches(messages, cuts):
    """The messages in several blocks, with other bytes between them."""
    edges = [0, *sorted(cut % (len(messages) + 1) for cut in cuts), len(messages)]
    for first, last in pairwise(edges):
        raw, places = b"", []
        for message in messages[first:last]:
            raw += b"\x01between"
            places.append((len(raw), len(raw) + len(message)))
            raw += message
        if places:
            yield Batch(np.frombuffer(raw, np.uint8), np.array(places, np.int64))


# ---------------------------------------------------------------- frames


def frame(n, layout):
    """One frame of two bodies, serialised in the usual order, or in another one."""
    rng = np.random.default_rng(n)
    fields = {
        "body_position": rng.normal(size=6).tolist(),
        "body_orientation": rng.normal(size=8).tolist(),
        "joint_position": rng.normal(size=3).tolist(),
        "channel": [float(n)],
    }
    head = message_class("Frame")(frame_index=n, time=n * 0.1).SerializeToString()
    rest = [message_class("Frame")(**{k: v}).SerializeToString() for k, v in fields.items()]
    if layout == "turned":
        return b"".join(reversed(rest)) + head
    if layout == "in two pieces":  # protobuf joins what comes twice
        half = (
            {"body_position": fields["body_position"][:3]},
            {"body_position": fields["body_position"][3:]},
        )
        return head + b"".join(
            message_class("Frame")(**piece).SerializeToString()
            for piece in (*half, {k: v for k, v in fields.items() if k != "body_position"})
        )
    return head + b"".join(rest)


layouts = st.lists(
    st.sampled_from(["usual"] * 6 + ["turned", "in two pieces"]), min_size=1, max_size=12
)


@given(layouts, st.lists(st.integers(0, 99), max_size=3), st.integers(1, 12))
def test_frames(kinds, cuts, count):
    messages = [frame(n, kind) for n, kind in enumerate(kinds)]
    count = min(count, len(messages))
    found = frame_columns(list(batches(messages, cuts)), count, "x")
    for n, message in enumerate(messages[:count]):
        expected = message_class("Frame").FromString(message)
        assert (found["frame_index"][n], found["time"][n]) == (n, expected.time)
        for name in PACKED:
            assert found[name][n].tolist() == list(getattr(expected, name))
    assert {found[name].shape for name in PACKED} == {(count, width) for width in (0, 1, 3, 6, 8)}


# ---------------------------------------------------------------- contacts


def own_cloud(n, points):
    """A cloud as we write it: stamp, layout, and a number of points."""
    cloud = empty_cloud()
    cloud.timestamp.FromNanoseconds(n * 10**9 + n % 7)
    rng = np.random.default_rng(n)
    given = np.zeros(points, POINT)
    given["force"] = rng.normal(size=(points, 3))
    given["geom1"], given["geom2"] = n % 5, 5 + n % 3
    cloud.data = given.tobytes()
    return cloud


def points_of(cloud):
    """(C, 5): force, geom1, geom2 by protobuf and NumPy alone."""
    kinds = {3: "<u2", 5: "<u4", 7: "<f4", 8: "<f8"}  # PackedElementField.NumericType
    layout = np.dtype(
        {
            "names": [f.name for f in cloud.fields],
            "formats": [kinds[f.type] for f in cloud.fields],
            "offsets": [f.offset for f in cloud.fields],
            "itemsize": cloud.point_stride,
        }
    )
    rows = np.frombuffer(cloud.data, layout)
    return [[float(row[name]) for name in ("fx", "fy", "fz", "geom1", "geom2")] for row in rows]


sizes = st.sampled_from([0, 1, 2, 3, 40, 400]) | st.just("foreign")


@given(st.lists(sizes, max_size=10), st.lists(st.integers(0, 99), max_size=3), st.integers(0, 10))
def test_contacts(kinds, cuts, count):
    clouds = [
        foreign_cloud(n) if kind == "foreign" else own_cloud(n, kind)
        for n, kind in enumerate(kinds)
    ]
    count = min(count, len(clouds))
    messages = [cloud.SerializeToString() for cloud in clouds]
    points, counts = cloud_points(list(batches(messages, cuts)), count, "x")
    expected = [points_of(cloud) for cloud in clouds[:count]]
    assert counts.tolist() == [len(rows) for rows in expected]
    found = [[*p["force"].tolist(), float(p["geom1"]), float(p["geom2"])] for p in points]
    assert found == [row for rows in expected for row in rows]


def without(field):
    cloud = foreign_cloud(1)
    kept = [f for f in cloud.fields if f.name != field]
    del cloud.fields[:]
    cloud.fields.extend(kept)
    return cloud.SerializeToString()


@pytest.mark.parametrize(
    ("message", "error"),
    [
        (own_cloud(3, 2).SerializeToString()[:-1], "the contacts of frame 3 are no point cloud"),
        (b"\xff" * 600, "the contacts of frame 3 are no point cloud"),
        (without("fy"), "the contacts of frame 3 lack the field 'fy'"),
        (PointCloud(data=b"abc").SerializeToString(), "frame 3 lack the field 'x'"),
        (
            PointCloud(
                fields=empty_cloud().fields, point_stride=48, data=bytes(49)
            ).SerializeToString(),
            "frame 3 are no table of points",
        ),
        (
            PointCloud(
                fields=empty_cloud().fields, point_stride=4, data=bytes(48)
            ).SerializeToString(),
            "frame 3 are no table of points",
        ),
    ],
)
def test_a_broken_message_is_reported(message, error):
    good = own_cloud(0, 2).SerializeToString()
    some = list(batches([good, good, good, message, good], [2]))
    with pytest.raises(TraceError, match=error):
        cloud_points(some, 5, "x")
