"""Hostile recordings with transforms: ROS 2 bags, and Foxglove's in JSON and protobuf."""

from __future__ import annotations

import io
import json
from abc import abstractmethod
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import mcap_target as mcap
from bags import ARM, TF_MESSAGE, ros_transform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.json_format import ParseDict, ParseError
from google.protobuf.message import Message
from import_target import Import, episode
from mcap.writer import CompressionType, Writer
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as RosWriter
from strange import NAMES, altered

FRAMES = 6
STEP = 50_000_000
"""ns between messages."""

Tree = dict[str, Any]

ON_RECORDS = (mcap._bytes, mcap._bytes, mcap._order, mcap._inside, mcap._bomb, mcap._names)


class Recording(Import):
    """One MCAP file of somebody else's: its records damaged, or its messages said otherwise."""

    def write(self, folder: Path) -> tuple[Path, str]:
        """Transforms of a cube, and what says its shape."""
        folder.mkdir()
        self.sound = self.messages()
        self.seeds = [form(self.sound) for form in self.forms()]
        for n, seed in enumerate(self.seeds):
            (folder / f"run{n}").mkdir()
            (folder / f"run{n}/run.mcap").write_bytes(seed)
        return folder / "run0/run.mcap", ""

    @abstractmethod
    def messages(self) -> Tree:
        """Content of the sound recording."""

    @abstractmethod
    def forms(self) -> list[Callable[[Tree], bytes]]:
        """Ways to write messages."""

    def hurt(self, rng: Random, path: Path) -> tuple[str, bool]:
        """Damage to the records, or another message."""
        file = path / "run0/run.mcap"
        if rng.random() < 0.45:
            act = rng.choice(ON_RECORDS)
            data, what, is_damage = act(rng, rng.choice(self.seeds))
            file.write_bytes(data)
            return f"{act.__name__.strip('_')}: {what}", is_damage
        while True:
            tree, what = self.sound, ""
            try:
                for _ in range(rng.choice((1, 1, 1, 3))):
                    tree, what = reordered(rng, tree) if rng.random() < 0.3 else altered(rng, tree)
                file.write_bytes(rng.choice(self.forms())(tree))
            except Exception:  # noqa: BLE001 — what a writer refuses is no input
                continue
            return what, False


class RosBag(Recording):
    """Messages in CDR, and a description of the robot."""

    name = "ROS 2 bag"
    read_by = ("mcap", "mcap-ros2-support")

    def messages(self) -> Tree:
        """A cube that moves, a table, and an arm with its description."""
        moving, ours = [], episode()
        for n in range(FRAMES):
            position = ours.tracks["cube"].position[n]
            moving.append(
                [
                    ros_transform(n * STEP, "map", "cube", position, (1, 0, 0, 0)),
                    ros_transform(n * STEP, "map", "upper", (0, 0, 0.3), (1, 0, 0, 0)),
                    ros_transform(n * STEP, "upper", "hand", (0, 0, 0.4), (1, 0, 0, 0)),
                ]
            )
        still = [ros_transform(0, "map", "table", (0, 0, -0.02), (1, 0, 0, 0))]
        return {"text": ARM, "static": still, "tf": moving}

    def forms(self) -> list[Callable[[Tree], bytes]]:
        """CDR alone."""
        return [_in_cdr]

    def hurt(self, rng: Random, path: Path) -> tuple[str, bool]:
        """Now and then, a folder of a bag that has another thing in it."""
        if rng.random() < 0.05:
            name = rng.choice(("metadata.yaml", "run_1.mcap", "run_1.db3", "\udcff.mcap"))
            (path / "run0" / name).write_bytes(
                rng.choice((b"", b"rosbag2_bagfile_information:", b"\x89MCAP"))
            )
            return f"{name!r} beside it", False
        return super().hurt(rng, path)


class Foxglove(Recording):
    """Messages in protobuf and JSON, with a scene."""

    name = "Foxglove transforms"
    read_by = ("mcap", "mcap-protobuf-support", "protobuf")

    def messages(self) -> Tree:
        """A cube that moves, with its shape in a scene."""
        moving = [
            [
                {
                    "timestamp": {"seconds": 0, "nanos": n * STEP},
                    "parent_frame_id": "map", "child_frame_id": name,
                    "translation": {"x": 0.01 * n * (name == "cube"), "y": 0.0, "z": 0.02},
                    "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
                }
                for name in ("cube", "table")
            ]
            for n in range(FRAMES)
        ]  # fmt: skip
        none = {"x": 0.0, "y": 0.0, "z": 0.0}
        here = {"position": none, "orientation": {**none, "w": 1.0}}
        size = {"x": 0.04, "y": 0.04, "z": 0.04}
        entity = {
            "id": "cube", "frame_id": "cube", "frame_locked": True,
            "cubes": [{"pose": here, "size": size}],
            "spheres": [{"pose": here, "size": size}],
            "cylinders": [{"pose": here, "size": size, "bottom_scale": 1.0, "top_scale": 1.0}],
            "triangles": [
                {
                    "pose": here, "points": [size, none, {**none, "y": 1.0}, {**none, "z": 1.0}],
                    "indices": [0, 1, 2, 0, 2, 3, 0, 1, 3, 1, 2, 3],
                }
            ],
        }  # fmt: skip
        return {"scene": {"entities": [entity]}, "tf": moving}

    def forms(self) -> list[Callable[[Tree], bytes]]:
        """Both."""
        return [_in_protobuf, _in_json]


def reordered(rng: Random, tree: Tree) -> tuple[Tree, str]:
    """A message gone, twice, or exchanged; a frame that is its own parent, or has two."""
    moving = [[dict(one) for one in message] for message in tree["tf"]]
    at, other = rng.randrange(len(moving)), rng.randrange(len(moving))
    act = rng.choice(("gone", "twice", "swap", "parent", "name", "one alone", "none"))
    if act == "gone":
        del moving[at]
    elif act == "twice":
        moving.insert(at, moving[other])
    elif act == "swap":
        moving[at], moving[other] = moving[other], moving[at]
    elif act == "one alone":
        moving = moving[:1]
    elif act == "none":
        moving = []
    else:
        every = rng.random() < 0.5
        new = rng.choice((*NAMES, "map", "hand", "cube"))
        key = "child_frame_id" if act == "name" else "parent_frame_id"
        for message in moving if every else [moving[at]]:
            one = rng.choice(message)
            if key in one:
                one[key] = new
            elif "header" in one:
                one["header"] = {**one["header"], "frame_id": new}
    return {**tree, "tf": moving}, f"transforms {act} at {at}"


def _in_cdr(tree: Tree) -> bytes:
    out = io.BytesIO()
    writer = RosWriter(out, compression=CompressionType.LZ4)
    text = writer.register_msgdef("std_msgs/msg/String", "string data")
    writer.write_message("/robot_description", text, {"data": tree["text"]}, 0, 0)
    tf = writer.register_msgdef("tf2_msgs/msg/TFMessage", TF_MESSAGE)
    for topic, messages in (("/tf_static", [tree["static"]]), ("/tf", tree["tf"])):
        for n, transforms in enumerate(messages):
            writer.write_message(topic, tf, {"transforms": transforms}, n * STEP, n * STEP)
    writer.finish()
    return out.getvalue()


def _in_protobuf(tree: Tree) -> bytes:
    out = io.BytesIO()
    writer = ProtobufWriter(out, compression=CompressionType.LZ4)
    writer.write_message("/scene", _message(tree["scene"], SceneUpdate()), 0, 0)
    for n, transforms in enumerate(tree["tf"]):
        said = _message({"transforms": transforms}, FrameTransforms())
        writer.write_message("/tf", said, n * STEP, n * STEP)
    writer.finish()
    return out.getvalue()


def _message(said: Any, into: Message) -> Message:
    """The message, with what the schema has no place for left out."""
    return ParseDict(_timed(said), into, ignore_unknown_fields=True)


def _timed(node: Any) -> Any:
    """Times as protobuf's JSON writes them, which is text."""
    if isinstance(node, list):
        return [_timed(item) for item in node]
    if not isinstance(node, dict):
        return node
    if node.keys() == {"seconds", "nanos"}:
        if not all(isinstance(value, int) for value in node.values()):
            raise ParseError("no time")
        seconds = node["seconds"] + node["nanos"] / 1e9
        return f"1970-01-01T00:00:{seconds:09.6f}Z"
    return {key: _timed(value) for key, value in node.items()}


def _in_json(tree: Tree) -> bytes:
    out = io.BytesIO()
    writer = Writer(out, compression=CompressionType.LZ4)
    writer.start()
    channels = {}
    for topic, name in (("/tf", "foxglove.FrameTransforms"), ("/scene", "foxglove.SceneUpdate")):
        schema = writer.register_schema(name, "jsonschema", b"{}")
        channels[topic] = writer.register_channel(topic, "json", schema)
    said = [("/scene", 0, tree["scene"])]
    said += [("/tf", n * STEP, {"transforms": one}) for n, one in enumerate(tree["tf"])]
    for topic, now, message in said:
        writer.add_message(channels[topic], now, json.dumps(message).encode(), now)
    writer.finish()
    return out.getvalue()


TARGETS = {"ros": RosBag, "foxglove": Foxglove}
