"""Writing an episode as one self-contained MCAP file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import build_file_descriptor_set

from safestage_eval.episode import Episode
from safestage_eval.formats.atomic import writing
from safestage_eval.formats.event import Event
from safestage_eval.formats.ply import to_ply
from safestage_eval.version import __version__

from .foxglove_scene import to_scene
from .mcap_frames import cloud_messages, frame_messages
from .mcap_messages import (
    CONTACTS,
    EVENTS,
    FRAME,
    PROFILE,
    SCENE,
    STATE,
    TF,
    log_time,
    message_class,
    schema_bytes,
)
from .mcap_metadata import to_texts

CHUNK_BYTES = 1 << 20
TF_RATE = 30.0
"""Hz, of the transforms for viewers; the evaluator reads the frames."""


def write_mcap(
    episode: Episode, path: Path, events: Sequence[Event] = (), *, placed: bool = False
) -> None:
    """Write the episode; the file appears whole or not at all.

    ``events`` stand in the channel ``/events`` beside start, success and end; viewers show them,
    and no reader takes them for data. ``placed``: as in ``cloud_messages``.

    Raises:
        TraceError: the header holds a number that is not finite.
    """
    moving = moving_bodies(episode)
    metadata = to_texts(episode, moving)
    with writing(path) as part, part.open("wb") as stream:
        writer = Writer(stream, chunk_size=CHUNK_BYTES, compression=CompressionType.LZ4)
        writer.start(profile=PROFILE, library=f"safestage {__version__}")
        # header and shapes come first, so that a file cut off still has them
        writer.add_metadata(PROFILE, metadata)
        for key in episode.header.mesh_keys:
            ply = to_ply(episode.meshes[key])
            writer.add_attachment(0, 0, f"geometry/{key}.ply", "application/octet-stream", ply)
        for name, data in episode.attachments.items():
            writer.add_attachment(0, 0, name, "application/octet-stream", data)
        _messages(writer, episode, moving, events, placed)
        writer.finish()


def moving_bodies(episode: Episode) -> list[str]:
    """The bodies of a ``Frame`` message, in its order."""
    return [name for name, track in episode.tracks.items() if _moves(episode, name, len(track))]


def _moves(episode: Episode, name: str, rows: int) -> bool:
    """True if a body is in every frame: those with one row per frame."""
    return rows == len(episode) and (rows > 1 or episode.bodies[name].movable)


def _messages(
    writer: Writer, episode: Episode, moving: list[str], remarks: Sequence[Event], placed: bool
) -> None:
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

    times = [log_time(t) for t in episode.t.tolist()]
    every = max(1, round(1 / (TF_RATE * episode.dt)))
    transforms = dict(transform_messages(episode, times, every))
    start = times[0]
    writer.add_message(tf, start, transforms.pop(0), start)
    writer.add_message(scene, start, to_scene(episode, start).SerializeToString(), start)
    notes = _events(episode, times, remarks)
    state_channel = own(STATE, "State") if episode.states else 0
    frames = frame_messages(episode, moving)
    clouds = cloud_messages(episode.contacts, times, placed=placed)
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


def transform_messages(
    episode: Episode, times: list[int], every: int
) -> Iterator[tuple[int, bytes]]:
    """Serialise the poses of all bodies in every so many frames as ``foxglove.FrameTransforms``.

    Args:
        episode: any.
        times: (T,) ns, log times of its frames.
        every: from one frame that is written to the next.

    Yields:
        (frame, message).
    """
    message, poses = FrameTransforms(), []
    for body in episode.header.bodies:
        message.transforms.add(parent_frame_id="world", child_frame_id=body.name)
        track = episode.track(body.name)
        poses.append(np.concatenate([track.position, track.orientation], 1)[::every].tolist())
    for n, here in zip(range(0, len(times), every), zip(*poses, strict=True), strict=True):
        for transform, pose in zip(message.transforms, here, strict=True):
            transform.timestamp.FromNanoseconds(times[n])
            position, turn = transform.translation, transform.rotation
            position.x, position.y, position.z = pose[:3]
            turn.w, turn.x, turn.y, turn.z = pose[3:]
        yield n, message.SerializeToString()


def _events(episode: Episode, times: list[int], remarks: Sequence[Event]) -> dict[int, list[bytes]]:
    """Frame → ``foxglove.Log`` messages: the instruction, success, how it ended, and remarks."""
    header, end = episode.header, float(episode.t[-1])
    lines = [Event(0.0, f"start: {header.instruction or header.task or header.episode_id}")]
    if header.success_time is not None:
        lines.append(Event(header.success_time, "success"))
    lines += [*remarks, Event(end, f"end: {header.termination or 'unknown'}")]
    levels = {"info": Log.INFO, "warning": Log.WARNING, "error": Log.ERROR}
    messages: dict[int, list[bytes]] = {}
    for line in lines:
        n = min(int(np.searchsorted(episode.t, line.time)), len(episode) - 1)
        log = Log(level=levels[line.level], message=line.text, name=line.name)
        log.timestamp.FromNanoseconds(times[n])
        messages.setdefault(n, []).append(log.SerializeToString())
    return messages
