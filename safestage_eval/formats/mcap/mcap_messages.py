"""The protobuf messages of package ``safestage.v1`` and the channels of an MCAP trace."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

PROFILE = "safestage"
"""MCAP profile, and name of the metadata record with the header."""

FRAME, CONTACTS, STATE = "/safestage/frame", "/safestage/contacts", "/safestage/state"
TF, SCENE, EVENTS = "/tf", "/scene", "/events"

EPOCH_NS = 946_684_800 * 10**9
"""ns, log time of t = 0: 2000-01-01T00:00:00Z, so that times before the start have one too."""


def log_time(t: float) -> int:
    """Return the log time in ns of an instant in s from the episode's start."""
    return EPOCH_NS + round(t * 1e9)


class Field(NamedTuple):
    """A field of a message."""

    number: int
    name: str
    type: str
    """``fixed64`` or ``double`` (single, always present), ``float*`` or ``double*`` (packed)."""
    meaning: str


MESSAGES: dict[str, tuple[str, tuple[Field, ...]]] = {
    "Frame": (
        "One frame. Bodies are those of the metadata record's list `moving`, in its order.",
        (
            Field(1, "frame_index", "fixed64", "counted from 0"),
            Field(2, "time", "double", "s from the episode's start"),
            Field(3, "body_position", "float*", "m, world: x, y, z of the first body, then …"),
            Field(4, "body_orientation", "float*", "w, x, y, z; body frame to world, unit norm"),
            Field(5, "body_linear_velocity", "float*", "m/s, of the body frame's origin, world"),
            Field(6, "body_angular_velocity", "float*", "rad/s, world"),
            Field(7, "joint_position", "float*", "rad or m, in the order of the header's joints"),
            Field(8, "joint_velocity", "float*", "rad/s or m/s"),
            Field(9, "joint_torque", "float*", "N m or N, by the actuators"),
            Field(10, "action", "float*", "command in force"),
            Field(11, "gripper", "float*", "opening, 0 closed to 1 open; absent without one"),
            Field(12, "channel", "float*", "in the order of the metadata record's `channels`"),
        ),
    ),
    "State": (
        "Full integration state of the simulator, about once per second.",
        (
            Field(1, "frame_index", "fixed64", "frame that it belongs to"),
            Field(2, "state", "double*", "as the simulator packs it"),
        ),
    ),
}


@cache
def file_descriptor() -> descriptor_pb2.FileDescriptorProto:
    """Return the descriptor of ``safestage/v1/trace.proto``."""
    file = descriptor_pb2.FileDescriptorProto(
        name="safestage/v1/trace.proto", package="safestage.v1", syntax="proto3"
    )
    kinds = descriptor_pb2.FieldDescriptorProto
    types = {
        "fixed64": kinds.TYPE_FIXED64,
        "double": kinds.TYPE_DOUBLE,
        "float*": kinds.TYPE_FLOAT,
        "double*": kinds.TYPE_DOUBLE,
    }
    for name, (_, fields) in MESSAGES.items():
        message = file.message_type.add(name=name)
        for f in fields:
            added = message.field.add(name=f.name, number=f.number, type=types[f.type])
            if f.type.endswith("*"):
                added.label = kinds.LABEL_REPEATED
            else:  # explicit presence: frame 0 and time 0 are written too
                added.label = kinds.LABEL_OPTIONAL
                added.proto3_optional = True
                added.oneof_index = len(message.oneof_decl)
                message.oneof_decl.add(name=f"_{f.name}")
    return file


@cache
def message_class(name: str) -> Any:
    """Return the class of a message of this package by its name."""
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file_descriptor())
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"safestage.v1.{name}"))


def schema_bytes() -> bytes:
    """Return the content of an MCAP schema record of this package: a serialised FileDescriptorSet."""
    return descriptor_pb2.FileDescriptorSet(file=[file_descriptor()]).SerializeToString()


def proto_text() -> str:
    """Return the messages of this package as a ``.proto`` file."""
    lines = ['syntax = "proto3";', "", "package safestage.v1;"]
    for name, (meaning, fields) in MESSAGES.items():
        lines += ["", f"// {meaning}", f"message {name} {{"]
        for f in fields:
            label = "repeated" if f.type.endswith("*") else "optional"
            lines.append(f"  // {f.meaning}")
            lines.append(f"  {label} {f.type.rstrip('*')} {f.name} = {f.number};")
        lines.append("}")
    return "\n".join(lines) + "\n"
