"""The tables of a map file, their entries and units."""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Callable
from hashlib import sha256
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from safestage_eval.episode import Header, Quat
from safestage_eval.episode.body import BodyKind, GeomKind, Stored
from safestage_eval.units import DIMENSIONS, UNIT_DIMENSION, finite, in_si

_NUMBER = re.compile(r"[-+]?(?:[0-9]+(?:\.[0-9]+)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?")


def _quantity(dimension: str) -> Callable[[Any], Any]:
    """Reads ``"4 cm"`` as 0.04; plain numbers are in SI already."""

    def read(value: Any) -> Any:
        if not isinstance(value, str):
            return value
        match = _NUMBER.match(value.strip())
        unit = value.strip()[match.end() :].strip() if match else ""
        if match is None or UNIT_DIMENSION.get(unit) != dimension:
            units = ", ".join(DIMENSIONS[dimension])
            raise ValueError(f"{value!r} is no {dimension}: a number with one of {units}")
        return finite(in_si(finite(match[0]), unit))

    return read


def _unit_of_length(value: Any) -> Any:
    """Reads ``"cm"`` as 0.01; a plain number is in metres already."""
    if not isinstance(value, str):
        return value
    if UNIT_DIMENSION.get(value) != "length":
        units = ", ".join(DIMENSIONS["length"])
        raise ValueError(f"{value!r} is no unit of length: one of {units}")
    return in_si(1.0, value)


Length = Annotated[float, BeforeValidator(_quantity("length"))]
Seconds = Annotated[float, BeforeValidator(_quantity("time")), Field(gt=0)]
Place = tuple[Length, Length, Length]
Names = Annotated[tuple[str, ...], BeforeValidator(lambda v: (v,) if isinstance(v, str) else v)]


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class SourceTable(_Table):
    """``[source]``."""

    quaternion: Literal["wxyz", "xyzw"] | None = None
    """Order in which the source writes quaternions."""
    dt: Seconds | None = None
    """s between its rows."""
    physics_dt: Seconds | None = None
    """s, integration step."""
    control_dt: Seconds | None = None
    """s between actions."""
    world: str | None = None
    """Frame that is the world, z up (transforms)."""
    scene: Literal["A", "B", "C", "D"] | None = None
    """CALVIN's scene."""
    velocities: Literal["recorded", "from poses"] | None = None
    """Whose velocities count; without it the poses', where recorded ones contradict them and are noisy."""
    length: Annotated[float, BeforeValidator(_unit_of_length), Field(gt=0)] | None = None
    """m in the source's unit of length, or its name: ``"cm"``, 0.0254; in metres without."""


class HeaderTable(_Table):
    """``[every]``, ``[task.NAME]``, ``[episode.NAME]``: header fields, as docs/traces.md has them."""

    task: str | None = None
    stage: Literal["ISH", "ETS", "FSH"] | None = None
    family: str | None = None
    instruction: str | None = None
    prompt: str | None = None
    policy: str | None = None
    seed: Stored | None = None
    rollout: Stored | None = None
    success: bool | None = None
    success_time: Seconds | None = None
    termination: Literal["success", "horizon", "policy", "error", "truncated"] | None = None
    horizon: Seconds | None = None
    post_success_hold: Seconds | None = None
    roles: dict[str, Names] = Field(default_factory=dict)
    goal: str | dict[str, Any] | None = None
    rules: Names = ()
    parameters: dict[str, str] = Field(default_factory=dict)
    simulator: str | None = None
    simulator_version: str | None = None
    licence: str | None = None

    def onto(self, header: Header) -> Header:
        """Return the header with these entries."""
        values = self.model_dump(exclude_unset=True)
        source = {k: values.pop(k) for k in tuple(values) if k not in Header.model_fields}
        for merged in ("roles", "parameters"):
            if merged in values:
                values[merged] = {**getattr(header, merged), **values[merged]}
        if source:
            values["source"] = header.source.model_copy(update=source)
        return header.model_copy(update=values)


class ShapeTable(_Table):
    """One of a body's ``shapes``; sizes are half extents and radii, as in docs/traces.md."""

    kind: GeomKind
    size: tuple[Length, ...] = ()
    position: Place = (0.0, 0.0, 0.0)
    orientation: Quat = (1.0, 0.0, 0.0, 0.0)
    friction: tuple[float, float, float] | None = None
    file: str | None = None
    """File of a mesh (OBJ, STL or PLY), relative to the map file."""
    scale: Annotated[float, Field(gt=0)] = 1.0
    """Scale of a mesh: metres per unit of the file."""


class CavityTable(_Table):
    """A container's ``cavity``."""

    kind: Literal["box", "cylinder"]
    size: tuple[Length, ...]
    position: Place = (0.0, 0.0, 0.0)
    orientation: Quat = (1.0, 0.0, 0.0, 0.0)


class TcpTable(_Table):
    """A gripper body's ``tcp``."""

    position: Place
    orientation: Quat = (1.0, 0.0, 0.0, 0.0)


class BodyTable(_Table):
    """``[body.NAME]``. What is left out stays as the source has it."""

    kind: BodyKind | None = None
    movable: bool | None = None
    mass: Annotated[float, Field(ge=0)] | None = None
    com: Place | None = None
    inertia: tuple[float, float, float] | None = None
    up: tuple[float, float, float] | Literal[False] | None = None
    """Up axis in the body frame; false: it has none (an orange)."""
    finger: Literal["left", "right"] | None = None
    tcp: TcpTable | None = None
    material: str | None = None
    tags: Names = ()
    parent: str | None = None
    excluded: Names = ()
    shapes: tuple[ShapeTable, ...] = ()
    cavity: CavityTable | Literal[False] | None = None
    """False: there is none."""
    position: Place | None = None
    """m, world: of a fixed body that the source does not have."""
    orientation: Quat = (1.0, 0.0, 0.0, 0.0)


class BodyColumns(_Table):
    """``[columns.body.NAME]``: columns of a table, or slices of them: ``"state[3:7]"``."""

    position: str
    orientation: str
    linear_velocity: str | None = None
    angular_velocity: str | None = None


class ColumnsTable(_Table):
    """``[columns]``: which columns of a table hold what (LeRobot, RLDS)."""

    body: dict[str, BodyColumns] = Field(default_factory=dict)
    time: str | None = None
    """s."""
    joint_position: str | None = None
    joint_velocity: str | None = None
    joint_torque: str | None = None
    action: str | None = None
    gripper: str | None = None
    success: str | None = None


T = TypeVar("T", bound=_Table)


def _merged(first: T, second: T) -> T:
    """The entries of both; the second's win."""
    said = {name: getattr(second, name) for name in second.model_fields_set}
    return first.model_copy(update=said)


class RobotTable(_Table):
    """``[robot]``: how the recorded joints belong to the description of ``--robot``."""

    joints: Names = ()
    """Its joints in the order of the recorded columns."""
    angle: Literal["rad", "deg"] | None = None
    """Unit of the positions of joints that turn; rad without."""


class InTable(_Table):
    """``[in."GLOB"]``: what holds in some files or episodes alone; it wins over the rest."""

    source: SourceTable = SourceTable()
    every: HeaderTable = HeaderTable()
    body: dict[str, BodyTable] = Field(default_factory=dict)
    columns: ColumnsTable | None = None


class MapFile(_Table):
    """A checked map file; without arguments an empty one."""

    source: SourceTable = SourceTable()
    every: HeaderTable = HeaderTable()
    task: dict[str, HeaderTable] = Field(default_factory=dict)
    episode: dict[str, HeaderTable] = Field(default_factory=dict)
    body: dict[str, BodyTable] = Field(default_factory=dict)
    columns: ColumnsTable | None = None
    robot: RobotTable = RobotTable()
    in_: dict[str, InTable] = Field(default_factory=dict, alias="in")
    path: str = Field(default="", exclude=True)
    """The map file's path; not a table in it."""

    @property
    def body_names(self) -> list[str]:
        """Names and patterns of all body entries."""
        return [*self.body, *(name for table in self.in_.values() for name in table.body)]

    def within(self, source: str) -> MapFile:
        """Return the map for one episode: with the entries of each ``[in."GLOB"]`` that fits its source.

        ``source``: its file and its name, ``"runs/PickCube.h5:traj_0"``; a glob may fit any part of it.
        """
        map_ = self
        for glob, table in self.in_.items():
            if not fnmatch.fnmatchcase(source, f"*{glob}*"):
                continue
            bodies = dict(map_.body)
            for name, entry in table.body.items():
                bodies[name] = _merged(bodies[name], entry) if name in bodies else entry
            map_ = map_.model_copy(
                update={
                    "source": _merged(map_.source, table.source),
                    "every": _merged(map_.every, table.every),
                    "body": bodies,
                    "columns": table.columns or map_.columns,
                }
            )
        return map_

    def of_body(self, name: str) -> BodyTable | None:
        """Return the entry for a body: by patterns, in their order, then by name; None if there is none."""
        fields: dict[str, Any] = {}
        matched = False
        for key in sorted(self.body, key=lambda key: key == name):  # stable: the name itself last
            if key == name or fnmatch.fnmatchcase(name, key):
                table = self.body[key]
                fields |= {field: getattr(table, field) for field in table.model_fields_set}
                matched = True
        return BodyTable.model_construct(**fields) if matched else None

    def header(self, header: Header, episode: str) -> Header:
        """Return the header with the entries of every episode, of its task and of itself (by source name)."""
        header = self.every.onto(header)
        if header.task in self.task:
            header = self.task[header.task].onto(header)
        return self.episode[episode].onto(header) if episode in self.episode else header

    @property
    def digest(self) -> str:
        """SHA-256 (hex) of the entries, 12 characters; "" without any."""
        text = self.model_dump_json(exclude_unset=True)
        return "" if text == "{}" else sha256(text.encode()).hexdigest()[:12]
