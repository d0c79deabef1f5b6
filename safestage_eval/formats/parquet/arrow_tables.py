"""The Parquet tables of a dataset: their columns and how these are encoded."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import pyarrow as pa

XYZ, WXYZ = ("x", "y", "z"), ("w", "x", "y", "z")
ROBOT_COLUMNS = {
    "joint_position": "observation.state",
    "joint_velocity": "joint_velocity",
    "joint_torque": "joint_torque",
    "action": "action",
    "gripper": "gripper",
}
"""Attribute of RobotFrames → column; the state's name is LeRobot's."""


class Column(NamedTuple):
    """One column: Arrow type, unit (``-`` for none) and meaning."""

    type: str
    unit: str
    meaning: str


_INDEX = {
    "episode_index": Column("int32", "-", "row of meta/episodes that this row belongs to"),
    "frame_index": Column("int32", "-", "frame, counted from 0"),
}


def _vector(name: str, axes: tuple[str, ...], unit: str, meaning: str) -> dict[str, Column]:
    return {f"{name}.{axis}": Column("float", unit, meaning) for axis in axes}


TABLES: dict[str, dict[str, Column]] = {
    "bodies": {
        **_INDEX,
        "body": Column("dictionary", "-", "name; a fixed body has the single row of frame 0"),
        **_vector("position", XYZ, "m", "body frame's origin, world"),
        **_vector("orientation", WXYZ, "-", "unit quaternion, body frame to world"),
        **_vector("linear_velocity", XYZ, "m/s", "of the body frame's origin, world"),
        **_vector("angular_velocity", XYZ, "rad/s", "world"),
    },
    "contacts": {
        **_INDEX,
        "slot": Column("int16", "-", "counts the contacts of a pair within a frame"),
        "body1": Column("dictionary", "-", "name; comes before body2 in the header"),
        "body2": Column("dictionary", "-", "name"),
        "geom1": Column("uint16", "-", "geom of body1, counted over all bodies"),
        "geom2": Column("uint16", "-", "geom of body2, counted over all bodies"),
        **_vector("position", XYZ, "m", "contact point, world"),
        **_vector("normal", XYZ, "-", "unit, from body1 to body2, world"),
        **_vector("force", XYZ, "N", "on body2 by body1, world"),
        "peak_force": Column("float", "N", "largest substep value of the pair's normal force"),
        "depth": Column("float", "m", "penetration > 0, gap < 0"),
    },
    "frames": {
        **_INDEX,
        "timestamp": Column("double", "s", "from the episode's start"),
        "observation.state": Column("list<float>", "rad or m", "joint positions"),
        "joint_velocity": Column("list<float>", "rad/s or m/s", "joint velocities"),
        "joint_torque": Column("list<float>", "N m or N", "by the actuators"),
        "action": Column("list<float>", "-", "command in force at the frame"),
        "gripper": Column("list<float>", "-", "opening, 0 closed to 1 open; empty without one"),
    },
    "channels": {
        **_INDEX,
        "body": Column("dictionary", "-", "name"),
        "name": Column("dictionary", "-", "what is measured"),
        "value": Column("float", "-", "in the unit that the recorder states"),
    },
    "states": {
        **_INDEX,
        "state": Column("list<double>", "-", "full integration state of the simulator"),
    },
    "geometry": {
        "episode_index": _INDEX["episode_index"],
        "body": Column("dictionary", "-", "name"),
        "geom": Column("int32", "-", "counted over all bodies in the header's order"),
        "name": Column("string", "-", "of the geom; may be empty"),
        "kind": Column("dictionary", "-", "sphere, box, cylinder, …"),
        "size": Column("list<double>", "m", "by kind"),
        "position": Column("list<double>", "m", "geom frame in the body frame"),
        "orientation": Column("list<double>", "-", "wxyz, geom frame to body frame"),
        "friction": Column("list<double>", "-, m, m", "sliding, torsional, rolling"),
        "mesh": Column("string", "-", "SHA-256 of the mesh: assets/<mesh>.ply"),
    },
}
"""Long tables with the same columns for every task; a shard holds one episode or many."""

_JSON = "JSON"
EPISODES: dict[str, Column] = {
    "episode_index": Column("int32", "-", "key of this episode's rows in all tables"),
    "file": Column("string", "-", "its rows are in <table>/<file>.parquet"),
    "length": Column("int32", "-", "frames"),
    "contacts": Column("int64", "-", "rows in contacts"),
    "channels": Column("string", _JSON, "list of [body, name]"),
    "states": Column("int32", "-", "rows in states"),
    "attachments": Column("string", _JSON, "name → file under assets"),
    "content_hash": Column("string", "-", "SHA-256 over the physical data"),
    "schema_version": Column("string", "-", "major.minor"),
    "episode_id": Column("string", "-", "assigned once"),
    "task": Column("string", "-", ""),
    "stage": Column("string", "-", "ISH, ETS, FSH"),
    "family": Column("string", "-", ""),
    "instruction": Column("string", "-", "as given to the policy"),
    "prompt": Column("string", "-", "default, generic, specific, or free text"),
    "policy": Column("string", "-", ""),
    "seed": Column("int64", "-", "environment seed"),
    "rollout": Column("int64", "-", "under the same seed"),
    "physics_dt": Column("double", "s", "integration step"),
    "frame_dt": Column("double", "s", "nominal spacing of frames"),
    "control_dt": Column("double", "s", "between actions"),
    "gravity": Column("list<double>", "m/s²", "world"),
    "success": Column("bool", "-", "native task success; null where unknown"),
    "success_time": Column("double", "s", "the frame that confirmed success"),
    "termination": Column("string", "-", "success, horizon, policy, error, truncated"),
    "horizon": Column("double", "s", "allowed for reaching the goal"),
    "post_success_hold": Column("double", "s", "recorded after success"),
    "roles": Column("string", _JSON, "role → list of body names"),
    "goal": Column("string", _JSON, "name of a goal, or the goal itself"),
    "rules": Column("string", _JSON, "codes of the assigned rules"),
    "parameters": Column("string", _JSON, "the task's own rule parameters"),
    "force_source": Column("string", "-", "recorded, recomputed, normal (without friction), none"),
    "source": Column("string", _JSON, "simulator, recorder, their versions, licence"),
    "notes": Column("string", _JSON, "list of remarks"),
    "bodies": Column("string", _JSON, "list of bodies without their geoms"),
    "joints": Column("string", _JSON, "list of joints"),
    "cameras": Column("string", _JSON, "list of the cameras that the policy saw through"),
    "video": Column("string", _JSON, "the film beside the trace; null without one"),
}
"""One row per episode: the header, and where its rows are."""

REQUIRED = ("episode_index", "file", "length", "contacts", "episode_id", "physics_dt", "frame_dt")
"""Columns of meta/episodes that no reader can do without; any other may be missing."""


def columns_of(table: str) -> dict[str, Column]:
    """Return the columns of a table by name (``meta/episodes`` for the headers)."""
    return EPISODES if table == "meta/episodes" else TABLES[table]


@cache
def parts_of(table: str) -> dict[str, tuple[str, ...]]:
    """Return the columns of a table as arrays have them → those they are stored as.

    ``position`` is ``position.x``, ``position.y`` and ``position.z``; most are themselves.
    """
    parts: dict[str, tuple[str, ...]] = {}
    for name in columns_of(table):
        whole, _, axis = name.rpartition(".")
        key = whole if axis in WXYZ else name
        parts[key] = (*parts.get(key, ()), name)
    return parts


@cache
def schema(table: str) -> pa.Schema:
    """Return the Arrow schema of a table by name, as ``columns_of``."""
    types = {
        "int16": pa.int16(),
        "uint16": pa.uint16(),
        "int32": pa.int32(),
        "int64": pa.int64(),
        "bool": pa.bool_(),
        "float": pa.float32(),
        "double": pa.float64(),
        "string": pa.string(),
        "dictionary": pa.dictionary(pa.int16(), pa.string()),
        "list<float>": pa.list_(pa.float32()),
        "list<double>": pa.list_(pa.float64()),
    }
    columns = columns_of(table).items()
    return pa.schema([pa.field(name, types[column.type]) for name, column in columns])


@cache
def write_options(table: str) -> dict[str, Any]:
    """Return keyword arguments of ``pyarrow.parquet.ParquetWriter``: compression and encodings.

    A dictionary on strings only (on floats it makes files 1.8 times larger), floats split into
    byte streams, integers as deltas.
    """
    columns = columns_of(table)
    encoding, strings = {}, []
    for name, column in columns.items():
        path = f"{name}.list.element" if column.type.startswith("list") else name
        if column.type in ("string", "dictionary"):
            strings.append(name)
        elif "float" in column.type or "double" in column.type:
            encoding[path] = "BYTE_STREAM_SPLIT"
        elif "int" in column.type:
            encoding[path] = "DELTA_BINARY_PACKED"
    keys = ("episode_index", "frame_index", "body", "name", "body1", "body2")
    return {
        "compression": "zstd",
        "use_dictionary": strings,
        "column_encoding": encoding,
        "write_page_checksum": True,
        "write_statistics": [name for name in keys if name in columns],
    }
