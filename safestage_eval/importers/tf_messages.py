"""Transforms, joint states, shapes and robot descriptions out of the messages of a recording.

Message definitions: tf2_msgs/TFMessage, geometry_msgs/TransformStamped, sensor_msgs/JointState (ROS),
foxglove.FrameTransform, .FrameTransforms and .SceneUpdate (docs.foxglove.dev).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError, TraceError

from .bag_files import messages
from .frame_tree import Samples

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
        others: topics that were not looked at.
        joints: name → times (ns) and positions (rad or m).
        disagreeing: frames that came under two parents; the first is kept.
    """

    samples: dict[str, Samples] = field(default_factory=dict)
    entities: dict[str, Any] = field(default_factory=dict)
    descriptions: list[str] = field(default_factory=list)
    others: set[str] = field(default_factory=set)
    disagreeing: set[str] = field(default_factory=set)
    joints: dict[str, tuple[list[int], list[float]]] = field(default_factory=dict)


def read_messages(paths: Iterable[Path]) -> Found:
    """Read all transforms, scenes and descriptions of the files, which are parts of one recording.

    Raises:
        TraceError: a file is damaged.
        SourceError: messages in an encoding that cannot be read here.
    """
    found = Found()
    for path in paths:
        try:
            for kind, topic, time, decode in messages(path):
                if kind in TRANSFORMS:
                    _take_transforms(found, decode(), time)
                elif kind in SCENES:
                    found.entities |= {e.id: e for e in getattr(decode(), "entities", ())}
                elif kind == JOINTS:
                    _take_joints(found, decode(), time)
                elif kind == DESCRIPTION and topic.rstrip("/").endswith("robot_description"):
                    found.descriptions.append(decode().data)
                else:
                    found.others.add(topic)
        except InputError:
            raise
        except Exception as error:  # noqa: BLE001 — decoders fail in many ways on damaged bytes
            raise TraceError(str(path), f"cannot be read: {error_line(error)}.") from None
    return found


def error_line(error: Exception) -> str:
    """Describe an error of a message in one line."""
    if isinstance(error, AttributeError) and error.name is not None:
        return f"a message without {error.name!r}"
    lines = str(error).splitlines() or [""]
    return f"{type(error).__name__}: {lines[0][:200]}" if lines[0] else type(error).__name__


def _take_transforms(found: Found, message: Any, log_time: int) -> None:
    several = getattr(message, "transforms", None)
    for one in [message] if several is None else several:
        if hasattr(one, "header"):  # ROS: TransformStamped
            stamp, parent = one.header.stamp, one.header.frame_id
            moved, turned = one.transform.translation, one.transform.rotation
        else:
            stamp, parent = one.timestamp, one.parent_frame_id
            moved, turned = one.translation, one.rotation
        parent, child = parent.strip("/"), one.child_frame_id.strip("/")
        samples = found.samples.setdefault(child, Samples(parent))
        if samples.parent != parent:
            found.disagreeing.add(child)
            continue
        samples.time.append(_nanoseconds(stamp, log_time))
        pose = moved.x, moved.y, moved.z, turned.w, turned.x, turned.y, turned.z
        samples.pose.append(tuple(map(float, pose)))


def _take_joints(found: Found, message: Any, log_time: int) -> None:
    time = _nanoseconds(message.header.stamp, log_time)
    for name, position in zip(message.name, message.position, strict=False):  # either may be empty
        times, positions = found.joints.setdefault(str(name), ([], []))
        times.append(time)
        positions.append(float(position))


def _nanoseconds(stamp: Any, log_time: int) -> int:
    """Nanoseconds of a ROS, protobuf or JSON time, or when it was logged. Raises ValueError beyond 64 bits."""
    whole = getattr(stamp, "sec", getattr(stamp, "seconds", 0))
    names = ("nanosec", "nsec", "nanos")
    part = next((getattr(stamp, name) for name in names if hasattr(stamp, name)), 0)
    time = int(whole) * 10**9 + int(part) or log_time
    if abs(time) > LATEST:
        raise ValueError(f"a transform at {time} ns")
    return time
