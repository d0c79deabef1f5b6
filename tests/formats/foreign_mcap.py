"""An MCAP trace as somebody else may write it with stock libraries, one message at a time."""

import json

import numpy as np
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from safestage_eval.formats.mcap.mcap_messages import message_class, schema_bytes

HEADER = {
    "episode_id": "foreign",
    "physics_dt": 0.01,
    "frame_dt": 0.1,
    "bodies": [
        {"name": "cup", "kind": "object", "geoms": [{"kind": "sphere", "size": [0.03]}]},
        {
            "name": "table",
            "kind": "fixture",
            "movable": False,
            "geoms": [{"kind": "box", "size": [1, 1, 0.1]}],
        },
    ],
}


def foreign(path, *, compression=CompressionType.ZSTD, chunks=True, frame=None, **metadata):
    """Four frames; ``frame(n)`` and ``metadata`` replace what would be right."""
    with path.open("wb") as stream:
        writer = Writer(stream, compression=compression, use_chunking=chunks)
        writer.start(profile="safestage")
        texts = {
            "schema_version": "1.0",
            "header": json.dumps(HEADER),
            "fixed": json.dumps({"table": [0, 0, -0.1, 1, 0, 0, 0, *[0] * 6]}),
        }
        writer.add_metadata("safestage", texts | metadata)
        own = writer.register_schema("safestage.v1.Frame", "protobuf", schema_bytes())
        frames = writer.register_channel("/safestage/frame", "protobuf", own)
        schema = build_file_descriptor_set(PointCloud).SerializeToString()
        point_cloud = writer.register_schema("foxglove.PointCloud", "protobuf", schema)
        contacts = writer.register_channel("/safestage/contacts", "protobuf", point_cloud)
        for n in range(4):
            fields = {
                "frame_index": n,
                "time": n * 0.1,
                "body_position": [0, 0, 0.03],
                "body_orientation": [1, 0, 0, 0],
                "body_linear_velocity": [0, 0, 0],
                "body_angular_velocity": [0, 0, 0],
            }
            fields |= frame(n) if frame else {}
            message = message_class("Frame")(**fields)
            writer.add_message(frames, n, message.SerializeToString(), n)
            writer.add_message(contacts, n, foreign_cloud(n).SerializeToString(), n)
        writer.finish()


def foreign_cloud(n):
    """Float64 points with a field of their own, geoms as 32-bit integers, from cup to table."""
    names = ["geom1", "geom2", "x", "y", "z", "nx", "ny", "nz", "fx", "fy", "fz"]
    names += ["colour", "depth", "peak_force"]
    whole = ("geom1", "geom2")
    layout = np.dtype([(name, "<u4" if name in whole else "<f8") for name in names])
    cloud = PointCloud(frame_id="map", point_stride=layout.itemsize)
    for name in names:
        kind = PackedElementField.UINT32 if name in whole else PackedElementField.FLOAT64
        cloud.fields.add(name=name, offset=layout.fields[name][1], type=kind)
    points = np.zeros(n % 2, layout)
    points["geom2"], points["nz"], points["fz"], points["peak_force"] = 1, -1, -3, 3
    cloud.data = points.tobytes()
    return cloud
