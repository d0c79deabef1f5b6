"""Writing an episode as one self-contained MCAP file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.timestamp_pb2 import Timestamp
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set
from numpy.typing import NDArray

from safestage_eval import __version__
from safestage_eval.episode import ContactTable, Episode

from . import wire
from .atomic import replacing
from .contact_points import POINT
from .episode_row import mesh_keys
from .mcap_clouds import empty_cloud
from .mcap_messages import (
    CONTACTS,
    EVENTS,
    FRAME,
    PROFILE,
    ROBOT,
    SCENE,
    STATE,
    TF,
    log_time,
    message_class,
    schema_bytes,
)
from .mcap_metadata import TRACK_COLUMNS, to_texts
from .ply import to_ply
from .scene import to_scene
from .urdf import to_urdf

CHUNK_BYTES = 1 << 20
TF_RATE = 30.0
"""Hz, of the transforms for viewers; the evaluator reads the frames."""

ROBOT_FIELDS = ("joint_position", "joint_velocity", "joint_torque", "action", "gripper")


def write_mcap(episode: Episode, path: Path) -> None:
    """Write the episode; the file appears whole or not at all.

    Raises:
        TraceError: the header holds a number that is not finite.
    """
    moving = [name for name, track in episode.tracks.items() if _moves(episode, name, len(track))]
    metadata = to_texts(episode, moving)
    with replacing(path) as part, part.open("wb") as stream:
        writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.LZ4)
        writer.start(profile=PROFILE, library=f"safestage {__version__}")
        # header and shapes come first, so that a file cut off still has them
        writer.add_metadata(PROFILE, metadata)
        for key in mesh_keys(episode.header):
            ply = to_ply(episode.meshes[key])
            writer.add_attachment(0, 0, f"geometry/{key}.ply", "application/octet-stream", ply)
        for name, data in episode.attachments.items():
            writer.add_attachment(0, 0, name, "application/octet-stream", data)
        _messages(writer, episode, moving)
        writer.finish()


def _moves(episode: Episode, name: str, rows: int) -> bool:
    """Whether a body is in every frame: those with one row per frame."""
    return rows == len(episode) and (rows > 1 or episode.bodies[name].movable)


def _messages(writer: Writer, episode: Episode, moving: list[str]) -> None:
    def channel(topic: str, message: Any) -> int:
        data = build_file_descriptor_set(message).SerializeToString()
        schema = writer.register_schema(message.DESCRIPTOR.full_name, "protobuf", data)
        return int(writer.register_channel(topic, "protobuf", schema))

    def own(topic: str, name: str) -> int:
        schema = writer.register_schema(f"safestage.v1.{name}", "protobuf", schema_bytes())
        return int(writer.register_channel(topic, "protobuf", schema))

    frame, contacts = own(FRAME, "Frame"), channel(CONTACTS, PointCloud)
    tf, scene, events = (
        channel(TF, FrameTransforms),
        channel(SCENE, SceneUpdate),
        channel(EVENTS, Log),
    )
    text = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
    robot = writer.register_channel(ROBOT, "cdr", text)

    times = [log_time(t) for t in episode.t.tolist()]
    every = max(1, round(1 / (TF_RATE * episode.dt)))
    transforms = dict(_transforms(episode, times, every))
    start = times[0]
    writer.add_message(tf, start, transforms.pop(0), start)
    writer.add_message(scene, start, to_scene(episode, start).SerializeToString(), start)
    writer.add_message(robot, start, _cdr_string(to_urdf(episode)), start)
    notes = _events(episode, times)
    state_channel = own(STATE, "State") if episode.states else 0
    frames, clouds = _frames(episode, moving), _clouds(episode.contacts, times)
    for n, (time, data, cloud) in enumerate(zip(times, frames, clouds, strict=True)):
        writer.add_message(frame, time, data, time, n)
        writer.add_message(contacts, time, cloud, time, n)
        if n in transforms:
            writer.add_message(tf, time, transforms[n], time, n)
        for message in notes.get(n, ()):
            writer.add_message(events, time, message, time, n)
        if n in episode.states:
            state = message_class("State")(frame_index=n, state=episode.states[n].tolist())
            writer.add_message(state_channel, time, state.SerializeToString(), time, n)


def _frames(episode: Episode, moving: list[str]) -> Iterator[bytes]:
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


def _clouds(contacts: ContactTable, times: list[int]) -> Iterator[bytes]:
    points = np.empty(len(contacts), POINT)
    for name in POINT.names or ():
        points[name] = getattr(contacts, name)
    ends = np.searchsorted(contacts.frame, np.arange(len(times) + 1)) * POINT.itemsize
    whole, fixed = points.tobytes(), empty_cloud().SerializeToString(deterministic=True)
    for time, begin, end in zip(times, ends[:-1].tolist(), ends[1:].tolist(), strict=True):
        yield _stamp(1, time) + fixed + wire.field(6, whole[begin:end])


def _stamp(number: int, time: int) -> bytes:
    stamp = Timestamp(seconds=time // 10**9, nanos=time % 10**9)
    return wire.field(number, stamp.SerializeToString())


def _transforms(episode: Episode, times: list[int], every: int) -> Iterator[tuple[int, bytes]]:
    """(frame, ``foxglove.FrameTransforms`` of all bodies) at about TF_RATE."""
    shown = np.arange(0, len(times), every)
    heads, poses = [], []
    for body in episode.header.bodies:
        track = episode.track(body.name)
        heads.append(wire.field(2, b"world") + wire.field(3, body.name.encode()))
        poses.append(_pose_fields(track.position[shown], track.orientation[shown]))
    for i, n in enumerate(shown.tolist()):
        stamp = _stamp(1, times[n])
        yield (
            n,
            b"".join(
                wire.field(1, stamp + head + pose[i].tobytes())
                for head, pose in zip(heads, poses, strict=True)
            ),
        )


def _pose_fields(
    position: NDArray[np.float32], orientation: NDArray[np.float32]
) -> NDArray[np.uint8]:
    """(T, 67) bytes: translation and rotation of a FrameTransform, zeros written out."""
    vector = [
        ("tag_x", "u1"),
        ("x", "<f8"),
        ("tag_y", "u1"),
        ("y", "<f8"),
        ("tag_z", "u1"),
        ("z", "<f8"),
    ]
    layout = np.dtype(
        [
            ("translation", "u1", 2),
            *[(f"t_{name}", kind) for name, kind in vector],
            ("rotation", "u1", 2),
            *[(f"r_{name}", kind) for name, kind in vector],
            ("r_tag_w", "u1"),
            ("r_w", "<f8"),
        ]
    )
    rows = np.empty(len(position), layout)
    rows["translation"] = list(wire.tag(4, wire.LENGTH) + wire.varint(27))
    rows["rotation"] = list(wire.tag(5, wire.LENGTH) + wire.varint(36))
    for number, axis in enumerate("xyz", 1):
        rows[f"t_tag_{axis}"] = rows[f"r_tag_{axis}"] = number << 3 | wire.FIXED64
        rows[f"t_{axis}"] = position[:, number - 1]
        rows[f"r_{axis}"] = orientation[:, number]
    rows["r_tag_w"], rows["r_w"] = 4 << 3 | wire.FIXED64, orientation[:, 0]
    return rows.view(np.uint8).reshape(len(rows), -1)


def _cdr_string(text: str) -> bytes:
    """A ``std_msgs/msg/String`` in little-endian CDR."""
    data = text.encode() + b"\0"
    return b"\x00\x01\x00\x00" + len(data).to_bytes(4, "little") + data


def _events(episode: Episode, times: list[int]) -> dict[int, list[bytes]]:
    """Frame → ``foxglove.Log`` messages: the instruction, success, and how it ended."""
    header, last = episode.header, len(episode) - 1
    lines = [(0, f"start: {header.instruction or header.task or header.episode_id}")]
    if header.success_time is not None:
        at = min(int(np.searchsorted(episode.t, header.success_time)), last)
        lines.append((at, "success"))
    lines.append((last, f"end: {header.termination or 'unknown'}"))
    found: dict[int, list[bytes]] = {}
    for n, text in lines:
        log = Log(level=Log.INFO, message=text, name="safestage")
        log.timestamp.FromNanoseconds(times[n])
        found.setdefault(n, []).append(log.SerializeToString())
    return found
