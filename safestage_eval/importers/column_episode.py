"""Tables of numbers as episodes: the map file's ``[columns]`` says which column holds what.

Formats for learning policies (LeRobot, RLDS) fix where images, robot state and actions are, not where
objects are. So nothing is taken for an object's pose by its name: ``[columns.body.NAME]`` says it.
"""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode, Joint, Track, still_track
from safestage_eval.errors import InputError, TraceError
from safestage_eval.formats.trace_files import arrow_file
from safestage_eval.size_limits import current

from .account import Account
from .foreign_motion import make_track, to_wxyz
from .importer import Importer, QuaternionOrder, Settings, SourceError
from .joint_columns import joint_column, plain
from .known_files import ask_for
from .map_tables import BodyColumns, ColumnsTable
from .missing_data import say_success
from .robot_file import load_robot
from .scene_builder import SceneBuilder

F64 = NDArray[np.float64]

POSE_WORDS = r"obj|pose|environment_state|body|sim_state"
"""Pattern of column names that may be poses of objects."""


class UnmappedError(SourceError):
    """A table of which nobody says what its columns are.

    Attributes:
        columns: that a map file may name.
    """

    columns: Collection[str] = ()


@dataclass(frozen=True)
class Rows:
    """The rows of one episode.

    Attributes:
        columns: column → (T, k).
        number: of the episode.
        t: (T,) s from the first row; None if the source does not tell.
        instruction: in words, if there is one.
    """

    columns: dict[str, F64]
    number: int
    t: F64 | None = None
    instruction: str | None = None


class ColumnImporter(Importer):
    """A dataset of tables, whose columns the map file assigns."""

    publisher = ""
    """Origin of the source, in its own words."""

    def __init__(self, path: Path, settings: Settings) -> None:
        """Take the map's columns; with a robot, those of its joints are enough.

        Raises:
            UnmappedError: there are none.
        """
        super().__init__(path, settings)
        self._columns: ColumnsTable = settings.map.columns or ColumnsTable()
        if not self._columns.body and settings.robot is None:
            error = self.no_map()
            with suppress(InputError):  # the columns are only a help
                error.columns = [
                    n if len(w) == 1 else f"{n}[0:{len(w)}]" for n, w in self.widths().items()
                ]
            raise error

    @abstractmethod
    def rows(self, name: str, wanted: Sequence[str]) -> Rows:
        """Read an episode, with those of the wanted columns that it has.

        Raises:
            SourceError: a column cannot be read.
            TraceError: the data are damaged.
        """

    @abstractmethod
    def widths(self) -> dict[str, Sequence[str]]:
        """Column of numbers → a name for each number in a row of it, empty where it has none."""

    def seen(self) -> list[str]:
        """Names of all columns of the source, without those of its bookkeeping."""
        return list(self.widths())

    def fingerprint(self, name: str) -> str:
        """Digest of the episode's first and last row in the mapped columns."""
        digest = sha256()
        for column, values in self._rows(name).columns.items():
            rows = np.ascontiguousarray(values[[0, -1]])
            digest.update(f"{column} {values.shape}".encode() + rows.tobytes())
        return digest.hexdigest()

    def read(self, name: str, account: Account) -> Episode:
        """Read one episode."""
        where = f"{self.path}: {name}"
        rows = self._rows(name)
        scene = SceneBuilder(self.settings, where, account)
        bodies = self._columns.body
        order: QuaternionOrder = scene.ask(lambda: self._order(where), "wxyz") if bodies else "wxyz"
        for body_name, spec in bodies.items():
            raw = Body(name=body_name, kind="object", untold=("up_axis", "cavity"))
            scene.bodies.append(scene.describe(raw))
            track = _track(rows.columns, spec, order, f"{where}: {body_name}")
            scene.tracks[body_name] = track
        scene.need_shapes(f"{self.title}s have none")
        t = scene.ask(lambda: self._time(rows, where), np.zeros(0))
        scene.refuse()
        self._robot(rows.columns, scene)
        self._remark(account)
        return scene.episode(t, com="the bodies' origins", **self._about(rows, t, account))

    def no_map(self) -> UnmappedError:
        """Return the error for a source of which nobody says where poses are."""
        seen = self.seen()
        likely = [name for name in seen if re.search(POSE_WORDS, name)]
        if not likely:
            names = f" ({', '.join(seen[:8])})" if seen else ""
            return UnmappedError(
                str(self.path),
                f"has no poses of objects, only what the robot saw and did{names}.",
                fix=ask_for(f"{self.path} {self.publisher} {' '.join(seen)}"),
            )
        return UnmappedError(
            str(self.path),
            "does not say which columns are poses of objects.",
            ", ".join(likely),
            f'--map FILE with [columns.body.NAME] position = "{likely[0]}[0:3]", orientation = '
            f'"{likely[0]}[3:7]" (docs/import/lerobot.md)',
        )

    def _rows(self, name: str) -> Rows:
        """The rows of an episode, with all columns that the map file names.

        Raises:
            SourceError: the source does not have one of them.
        """
        rows = self.rows(name, self._wanted)
        for column in self._wanted:
            if column not in rows.columns:
                raise SourceError(
                    self.settings.map.path or str(self.path),
                    f"[columns] names {column!r}, which is no column of numbers of {self.path.name}.",
                    ", ".join(self.widths()),
                )
        columns = {column: rows.columns[column] for column in self._wanted}
        if not columns:
            raise SourceError(str(self.path), "no column of it is named.", "[columns]")
        current().demand("frames", len(next(iter(columns.values()))), f"{self.path}: {name}")
        return Rows(columns, rows.number, rows.t, rows.instruction)

    @cached_property
    def _wanted(self) -> list[str]:
        """Names of the mapped columns."""
        said = self._columns.model_dump(exclude_none=True)
        texts = [text for body in said.pop("body").values() for text in body.values()]
        texts += [*said.values(), *([self._joints_at] if self._joints_at else [])]
        return list(dict.fromkeys(_split(text)[0] for text in texts))

    @cached_property
    def _joints_at(self) -> str:
        """The column of joint positions, or the part of it; "" where it is not needed.

        Raises:
            SourceError: none is known, and the robot needs one.
        """
        if self._columns.joint_position is not None or self.settings.robot is None:
            return self._columns.joint_position or ""
        model = load_robot(self.settings.robot, self.settings.assets)
        return joint_column(model, self.widths(), str(self.path))

    def _order(self, where: str) -> QuaternionOrder:
        order = self.settings.stated_order
        if order is None:
            raise SourceError(
                where,
                f"the order of its quaternions is not known: {self.name} prescribes none.",
                "wxyz, xyzw",
                "--quaternion, or [source] quaternion in the map file",
            )
        return order

    def _time(self, rows: Rows, where: str) -> F64:
        """(T,) s; what the user says wins."""
        count = len(next(iter(rows.columns.values())))
        dt = self.settings.stated_dt
        if dt is not None:
            return np.arange(count, dtype=np.float64) * dt
        if self._columns.time is not None:
            stamps: F64 = _part(rows.columns, self._columns.time, 1, where)[:, 0]
            return np.asarray(stamps - stamps[0])
        if rows.t is None:
            raise SourceError(
                where, "it does not say how much time lies between two rows.",
                fix='--dt TIME, or [columns] time = "COLUMN" in the map file',
            )  # fmt: skip
        return rows.t

    # ---- the robot

    def _robot(self, columns: dict[str, F64], scene: SceneBuilder) -> None:
        """Its columns; all its links by ``--robot``, with the base at the world's origin; else its base alone."""
        parts = {
            name: _part(columns, spec, None, scene.where)
            for name in ("joint_position", "joint_velocity", "joint_torque", "action", "gripper")
            if (spec := getattr(self._columns, name)) is not None
        }
        if self.settings.robot is not None:
            parts.pop("joint_position", None)
            unit = self._place(_part(columns, self._joints_at, None, scene.where), scene)
            if "joint_velocity" in parts:
                parts["joint_velocity"] = parts["joint_velocity"] * unit
            scene.record(**parts)
            return
        if not any(b.kind in ("robot", "gripper") for b in scene.bodies):
            base = Body(name="robot_base", kind="robot", movable=False, mass=0, untold=("links",))
            scene.add(base, still_track((0, 0, 0), (1, 0, 0, 0)))
        count = max((v.shape[1] for n, v in parts.items() if n.startswith("joint")), default=0)
        if count:
            scene.account.guessed("names and kinds of joints", "numbered, revolute")
        scene.joints += [Joint(name=f"joint_{i}", kind="revolute") for i in range(count)]
        scene.record(**parts)

    def _place(self, values: F64, scene: SceneBuilder) -> F64:
        """Add the robot's links by its joint positions; (n,) rad or m for one of what these are in."""
        if self._columns.joint_position is None:
            scene.account.guessed(
                "column of the joint positions", self._joints_at,
                remedy="[columns] joint_position in the map file",
            )  # fmt: skip
        entry = self.settings.map.of_body("robot_base")
        place = (0.0, 0.0, 0.0) if entry is None or entry.position is None else entry.position
        turn = (1.0, 0.0, 0.0, 0.0) if entry is None else tuple(entry.orientation)
        if entry is None or entry.position is None:
            scene.account.guessed(
                "place of the robot's base", "the origin of the world",
                remedy="[body.robot_base] position, orientation in the map file",
            )  # fmt: skip
        column, part = _split(self._joints_at)
        names = [plain(name) for name in self.widths().get(column, ())[part] if name]
        names = names if len(names) == values.shape[1] else []
        return scene.place_robot("robot_base", still_track(place, turn), values, names=names)

    # ---- the header and the account

    def _about(self, rows: Rows, t: F64, account: Account) -> dict[str, Any]:
        """Fields of the header besides bodies and joints."""
        dt = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
        physics = self.settings.map.source.physics_dt
        if physics is None:
            account.guessed(
                "physics step", "that of the rows", remedy="[source] physics_dt in the map file"
            )
        success = moment = None
        if self._columns.success is not None:
            reached = _part(rows.columns, self._columns.success, 1, str(self.path))[:, 0] > 0.5
            success = bool(reached.any())
            moment = float(t[int(np.argmax(reached))]) if success else None
        hold = None if moment is None else float(t[-1] - moment)
        say_success(account, known=success is not None, hold=hold, how="the robot went on")
        return {
            "task": rows.instruction,
            "instruction": rows.instruction,
            "rollout": rows.number,
            "physics_dt": physics or dt,
            "frame_dt": dt,
            "control_dt": dt,
            "success": success,
            "success_time": moment,
        }

    def _remark(self, account: Account) -> None:
        if not self._columns.body:
            account.missing(
                "objects", "only the robot's joints are recorded",
                cost="all rules on objects: inconclusive; --rules robot judges the robot itself",
                remedy="[columns.body.NAME] in the map file, if the table has their poses",
            )  # fmt: skip
            return
        account.missing(
            "bodies that no column is mapped to",
            cost="the robot's distances, contacts and grasps: inconclusive",
            remedy="[columns.body.NAME] in the map file",
        )
        derived = [n for n, spec in self._columns.body.items() if spec.linear_velocity is None]
        if derived:
            account.recomputed(
                f"velocities of {', '.join(derived)}", "differences of the poses",
                cost="impacts shorter than two rows are smoothed",
            )  # fmt: skip


def numbers(columns: Mapping[str, Any]) -> dict[str, F64]:
    """Column → (N, k) of those whose rows are numbers, as many in each; not of texts."""
    out = {}
    for name, values in columns.items():
        try:
            array = np.asarray(values, np.float64)
        except (ValueError, TypeError):
            continue
        if array.ndim in (1, 2) and array.size:
            out[name] = array.reshape(len(array), -1)
    return out


def parquet_columns(file: Path, wanted: Collection[str] | None = None) -> dict[str, F64]:
    """The columns of numbers of a Parquet file, or those of them that are wanted.

    Raises:
        TraceError: it is damaged, or would become more bytes than the limit allows.
    """
    import pyarrow.parquet as pq

    try:
        opened = pq.ParquetFile(arrow_file(file))
        meta, schema = opened.metadata, opened.schema
        names = [n for n in opened.schema_arrow.names if wanted is None or n in wanted]
        read = [i for i in range(meta.num_columns)
                if schema.column(i).path.partition(".")[0] in names]  # fmt: skip
        groups = [meta.row_group(n) for n in range(meta.num_row_groups)]
        values = sum(max(0, group.column(i).num_values) for group in groups for i in read)
        current().demand_decoded(8 * values, file.stat().st_size, str(file))
        table = opened.read(columns=names)
        return numbers({name: table[name].to_pylist() for name in table.column_names})
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, MemoryError) as error:
        if isinstance(error, TraceError):
            raise
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise TraceError(str(file), f"cannot be read: {reason}.", fix="download it again") from None


def _part(columns: dict[str, F64], text: str, width: int | None, where: str) -> F64:
    """Return (T, k) of a column or a part of it. Raises TraceError when it is not ``width`` wide."""
    name, part = _split(text)
    values = columns[name][:, part]
    if width is not None and values.shape[1] != width:
        raise TraceError(
            where, f"{text} has {values.shape[1]} numbers in a row.", f"{width} numbers",
            'name a part of the column: "observation.state[3:7]"',
        )  # fmt: skip
    return values


def _split(text: str) -> tuple[str, slice]:
    """``"observation.state[3:7]"`` → ``observation.state``, and its part."""
    match = re.fullmatch(r"(.*?)(?:\[(\d+)(?::(\d+))?\])?", text.strip(), re.DOTALL)
    assert match is not None
    if match[2] is None:
        return match[1], slice(None)
    first = int(match[2])
    return match[1], slice(first, int(match[3]) if match[3] else first + 1)


def _track(columns: dict[str, F64], spec: BodyColumns, order: QuaternionOrder, where: str) -> Track:
    """The track of a body by its columns."""
    widths = {"position": 3, "orientation": 4, "linear_velocity": 3, "angular_velocity": 3}
    parts = [
        None if (text := getattr(spec, name)) is None else _part(columns, text, width, where)
        for name, width in widths.items()
    ]
    position, turn, linear, angular = parts
    assert position is not None
    assert turn is not None
    return make_track(position, to_wxyz(turn, order, where), linear, angular)
