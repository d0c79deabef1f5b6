"""Transforms, shapes and robot descriptions out of other people's MCAP files.

Message definitions: tf2_msgs/TFMessage and geometry_msgs/TransformStamped (ROS 2), foxglove.FrameTransform,
.FrameTransforms and .SceneUpdate (docs.foxglove.dev), in CDR, protobuf or JSON.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from safestage_eval.errors import InputError, TraceError

from .frame_tree import Samples
from .importer import SourceError
from .mcap_whole import check_summary, whole_messages
from .ros_bag import Message, bag_messages, is_bag, types

TRANSFORMS = {
    "tf2_msgs/msg/TFMessage",
    "tf/msg/tfMessage",
    "geometry_msgs/msg/TransformStamped",
    "foxglove.FrameTransform",
    "foxglove.FrameTransforms",
    "foxglove_msgs/msg/FrameTransform",
    "foxglove_msgs/msg/FrameTransforms",
}
SCENES = {"foxglove.SceneUpdate", "foxglove_msgs/msg/SceneUpdate"}
DESCRIPTION = "std_msgs/msg/String"
JOINTS = "sensor_msgs/msg/JointState"

LATEST = 1 << 62
"""ns; a difference of two times still has 64 bits."""


@dataclass
class Found:
    """The contents of the files.

    Attributes:
        samples: frame → its transforms; times are those of the messages.
        entities: of scenes, by id; a later one replaces an earlier one.
        descriptions: URDF texts.
        others: topics that were not looked at, with their schema.
        joints: name → times (ns) and positions (rad or m).
        disagreeing: frames that came under two parents; the first is kept.
    """

    samples: dict[str, Samples] = field(default_factory=dict)
    entities: dict[str, Any] = field(default_factory=dict)
    descriptions: list[str] = field(default_factory=list)
    others: dict[str, str] = field(default_factory=dict)
    disagreeing: set[str] = field(default_factory=set)
    joints: dict[str, tuple[list[int], list[float]]] = field(default_factory=dict)


def has_transforms(path: Path) -> bool:
    """True if the file is a complete foreign MCAP or SQLite bag with transforms; raises SourceError without rosbags."""
    from mcap.reader import make_reader

    try:
        if is_bag(path):
            return bool(types(path) & TRANSFORMS)
        with path.open("rb") as stream:
            check_summary(stream)
            stream.seek(0)
            reader = make_reader(stream)
            if reader.get_header().profile == "safestage":
                return False
            summary = reader.get_summary()
            names = {s.name for s in summary.schemas.values()} if summary is not None else set()
            return bool(names & TRANSFORMS)
    except SourceError:
        raise
    except Exception:  # noqa: BLE001 — the readers of others fail in many ways on damaged bytes
        return False


def _stored(path: Path) -> Iterator[Message]:
    """Yield (type, topic, time in ns, what decodes it) of all messages of a bag or an MCAP file."""
    if is_bag(path):
        yield from bag_messages(path)
        return
    decoders: dict[Any, Callable[[bytes], Any]] = {}
    with path.open("rb") as stream:
        for schema, channel, message in whole_messages(stream):

            def decode(
                schema: Any = schema, channel: Any = channel, data: Any = message.data
            ) -> Any:
                if channel.id not in decoders:
                    decoders[channel.id] = _decoder(channel.message_encoding, schema, path)
                return decoders[channel.id](data)

            yield schema.name if schema else "", channel.topic, message.log_time, decode


def read_messages(paths: Iterable[Path]) -> Found:
    """Read all transforms, scenes and descriptions of the files, which are parts of one recording.

    Raises:
        TraceError: a file is damaged.
        SourceError: messages in an encoding that cannot be read here.
    """
    result = Found()
    for path in paths:
        try:
            for kind, topic, time, decode in _stored(path):
                take = _taker(kind, topic)
                if take is None:
                    result.others[topic] = kind or "-"
                else:
                    take(result, decode(), time)
        except InputError:
            raise
        except Exception as error:  # noqa: BLE001 — as above
            raise TraceError(str(path), f"cannot be read: {error_line(error)}.") from None
    return result


def error_line(error: Exception) -> str:
    """Describe an error of a message in one line."""
    if isinstance(error, AttributeError) and error.name is not None:
        return f"a message without {error.name!r}"
    lines = str(error).splitlines() or [""]
    return f"{type(error).__name__}: {lines[0][:200]}" if lines[0] else type(error).__name__


def _taker(schema: str, topic: str) -> Callable[[Found, Any, int], None] | None:
    if schema in TRANSFORMS:
        return _take_transforms
    if schema in SCENES:
        return _take_scene
    if schema == JOINTS:
        return _take_joints
    if schema == DESCRIPTION and topic.rstrip("/").endswith("robot_description"):
        return lambda contents, message, _: contents.descriptions.append(message.data)
    return None


def _decoder(encoding: str, schema: Any, path: Path) -> Callable[[bytes], Any]:
    if encoding == "json":
        return _from_json
    factory: Any
    if encoding == "protobuf":
        from mcap_protobuf.decoder import DecoderFactory

        factory = DecoderFactory()
    elif encoding == "cdr":
        try:
            from mcap_ros2.decoder import DecoderFactory as RosDecoderFactory
        except ImportError:
            raise SourceError(
                str(path), "ROS 2 messages need a package.", fix="pip install 'safestage[import]'"
            ) from None
        factory = RosDecoderFactory()
    else:
        raise SourceError(
            str(path), f"messages of {schema.name} in the encoding {encoding!r}.",
            "cdr (ROS 2), protobuf, json", "convert the recording, e.g. with `rosbags-convert`",
        )  # fmt: skip
    decode = factory.decoder_for(encoding, schema)
    if decode is None:
        raise SourceError(
            str(path), f"the schema of {schema.name} is written as {schema.encoding!r}.",
            "ros2msg, protobuf, jsonschema",
        )  # fmt: skip
    return decode  # type: ignore[no-any-return]


def _from_json(data: bytes) -> Any:
    if b"\\ud" in data.lower():  # half of a pair of UTF-16 is no name that could be written
        json.dumps(json.loads(data), ensure_ascii=False).encode()
    return json.loads(data, object_hook=lambda d: SimpleNamespace(**d))


def _take_transforms(contents: Found, message: Any, log_time: int) -> None:
    several = getattr(message, "transforms", None)
    for one in [message] if several is None else several:
        if hasattr(one, "header"):  # ROS: TransformStamped
            stamp, parent, child = one.header.stamp, one.header.frame_id, one.child_frame_id
            moved, turned = one.transform.translation, one.transform.rotation
        else:
            stamp, parent, child = one.timestamp, one.parent_frame_id, one.child_frame_id
            moved, turned = one.translation, one.rotation
        parent, child = parent.strip("/"), child.strip("/")
        samples = contents.samples.setdefault(child, Samples(parent))
        if samples.parent != parent:
            contents.disagreeing.add(child)
            continue
        samples.time.append(_within(_nanoseconds(stamp) or log_time))
        samples.position.append((float(moved.x), float(moved.y), float(moved.z)))
        turn = (float(turned.w), float(turned.x), float(turned.y), float(turned.z))
        samples.orientation.append(turn)


def _take_joints(contents: Found, message: Any, log_time: int) -> None:
    time = _within(_nanoseconds(message.header.stamp) or log_time)
    for name, position in zip(
        message.name, message.position, strict=False
    ):  # either may be left out
        times, positions = contents.joints.setdefault(str(name), ([], []))
        times.append(time)
        positions.append(float(position))


def _nanoseconds(stamp: Any) -> int:
    """Nanoseconds of a ROS, protobuf or JSON time; 0 where it was left out."""
    whole = getattr(stamp, "sec", getattr(stamp, "seconds", 0))
    names = ("nanosec", "nsec", "nanos")
    part = next((getattr(stamp, name) for name in names if hasattr(stamp, name)), 0)
    return int(whole) * 10**9 + int(part)


def _within(time: int) -> int:
    """Checked nanoseconds. Raises ValueError beyond 64 bits."""
    if abs(time) > LATEST:
        raise ValueError(f"a transform at {time} ns")
    return time


def _take_scene(contents: Found, message: Any, _: int) -> None:
    for entity in getattr(message, "entities", ()):
        contents.entities[entity.id] = entity
