"""Tables of numbers as episodes: the map file's ``[columns]`` says which column holds what.

Formats for learning policies (LeRobot, RLDS) fix where images, robot state and actions are, not where
objects are. So nothing is taken for an object's pose by its name: ``[columns.body.NAME]`` says it.
"""

from __future__ import annotations

import re
from abc import abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode, Joint, RobotFrames, Track, still_track
from safestage_eval.errors import TraceError
from safestage_eval.size_limits import current

from .account import Account
from .foreign_motion import make_track, to_wxyz
from .importer import Importer, QuaternionOrder, Settings, SourceError
from .joint_columns import joint_column, plain
from .known_files import ask_for
from .map_tables import BodyColumns, ColumnsTable
from .missing_data import say_success
from .place_robot import Placed
from .robot_file import load_robot
from .scene_builder import SceneBuilder, robot_frames

F64 = NDArray[np.float64]

POSE_WORDS = r"obj|pose|environment_state|body|sim_state"
"""Pattern of column names that may be poses of objects."""


@dataclass(frozen=True)
class Rows:
    """The rows of one episode.

    Attributes:
        columns: column → (T, k).
        number: of the episode.
        t: (T,) s from the first row; None if the source does not tell.
        instruction: in words, if there is one.
        joints: names of the numbers in the column of joint positions, if they have any.
    """

    columns: dict[str, F64]
    number: int
    t: F64 | None = None
    instruction: str | None = None
    joints: tuple[str, ...] = ()


class ColumnImporter(Importer):
    """A dataset of tables, whose columns the map file assigns."""

    def __init__(self, path: Path, settings: Settings) -> None:
        """Take the map's columns; with a robot, those of its joints are enough.

        Raises:
            SourceError: there are none.
        """
        super().__init__(path, settings)
        self._columns: ColumnsTable = settings.map.columns or ColumnsTable()
        if not self._columns.body and settings.robot is None:
            raise self.no_map()

    @abstractmethod
    def rows(self, name: str, wanted: Sequence[str]) -> Rows:
        """Read the wanted columns of an episode.

        Raises:
            SourceError: there is no such column.
            TraceError: the data are damaged.
        """

    def widths(self) -> dict[str, Sequence[str]]:
        """Column → the names of its numbers, as far as the source says; an empty name where it does not."""
        return {}

    @abstractmethod
    def seen(self) -> list[str]:
        """Names of all columns of the source, without those of its bookkeeping."""

    @abstractmethod
    def publisher(self) -> str:
        """Origin of the source, in its own words."""

    def fingerprint(self, name: str) -> str:
        """Digest of the episode's first and last row in the mapped columns."""
        digest = sha256()
        for column, values in self.rows(name, self._wanted).columns.items():
            rows = np.ascontiguousarray(values[[0, -1]])
            digest.update(f"{column} {values.shape}".encode() + rows.tobytes())
        return digest.hexdigest()

    def read(self, name: str, account: Account) -> Episode:
        """Read one episode."""
        where = f"{self.path}: {name}"
        rows = self.rows(name, self._wanted)
        columns = rows.columns
        current().demand("frames", len(next(iter(columns.values()))), where)
        scene = SceneBuilder(self.settings, where, account)
        bodies = self._columns.body
        order: QuaternionOrder = (
            scene.gaps.ask(lambda: self._order(where), "wxyz") if bodies else "wxyz"
        )
        for body_name, spec in bodies.items():
            raw = Body(name=body_name, kind="object", untold=("up_axis", "cavity"))
            scene.bodies.append(scene.describe(raw))
            scene.tracks[body_name] = _track(columns, spec, order, f"{where}: {body_name}")
        scene.need_shapes(f"{self.title}s have none")
        t = scene.gaps.ask(lambda: self._time(rows, where), np.zeros(0))
        scene.gaps.refuse()
        placed = self._placed(rows, scene)
        if placed is None and not any(b.kind in ("robot", "gripper") for b in scene.bodies):
            base = Body(name="robot_base", kind="robot", movable=False, mass=0, untold=("links",))
            scene.add(base, still_track((0, 0, 0), (1, 0, 0, 0)))
        frames, joints = self._robot(columns, len(t), scene, placed)
        self._remark(account)
        about = self._about(rows, t, account)
        return scene.episode(t, frames, com="the bodies' origins", joints=joints, **about)

    def no_map(self) -> SourceError:
        """Return the error for a source of which nobody says where poses are."""
        seen = self.seen()
        likely = [name for name in seen if re.search(POSE_WORDS, name)]
        if not likely:
            names = f" ({', '.join(seen[:8])})" if seen else ""
            return SourceError(
                str(self.path),
                f"has no poses of objects, only what the robot saw and did{names}.",
                fix=ask_for(f"{self.path} {self.publisher()} {' '.join(seen)}"),
            )
        return SourceError(
            str(self.path),
            "does not say which columns are poses of objects.",
            ", ".join(likely),
            f'--map FILE with [columns.body.NAME] position = "{likely[0]}[0:3]", orientation = '
            f'"{likely[0]}[3:7]" (docs/import/lerobot.md)',
        )

    @property
    def _map_path(self) -> str:
        return self.settings.map.path or str(self.path)

    @cached_property
    def _wanted(self) -> list[str]:
        """Names of the mapped columns."""
        spec = self._columns
        texts = [
            text
            for body in spec.body.values()
            for text in body.model_dump(exclude_none=True).values()
        ]
        texts += [v for k, v in spec.model_dump(exclude_none=True).items() if k != "body"]
        texts += [self._joints_at] * bool(self._joints_at)
        return list(dict.fromkeys([column_of(text) for text in texts]))

    @cached_property
    def _joints_at(self) -> str:
        """The column of joint positions, or the part of it; "" where it is not needed.

        Raises:
            SourceError: none is known, and the robot needs one.
        """
        if self._columns.joint_position is not None:
            return self._columns.joint_position
        if self.settings.robot is None:
            return ""
        model = load_robot(self.settings.robot, self.settings.assets)
        return joint_column(model, self.widths(), str(self.path))

    @property
    def joint_source(self) -> str:
        """Name of the column of joint positions; "" of none."""
        return column_of(self._joints_at) if self._joints_at else ""

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
            stamps: F64 = part_of(rows.columns, self._columns.time, 1, where)[:, 0]
            return np.asarray(stamps - stamps[0])
        if rows.t is None:
            raise SourceError(
                where, "it does not say how much time lies between two rows.",
                fix='--dt TIME, or [columns] time = "COLUMN" in the map file',
            )  # fmt: skip
        return rows.t

    def _placed(self, rows: Rows, scene: SceneBuilder) -> Placed | None:
        """The robot's links by ``--robot`` and the joint positions; its base stands at the world's origin."""
        if self.settings.robot is None:
            return None
        if self._columns.joint_position is None:
            scene.account.guessed(
                "column of the joint positions", self._joints_at,
                remedy="[columns] joint_position in the map file",
            )  # fmt: skip
        values = part_of(rows.columns, self._joints_at, None, scene.where)
        entry = self.settings.map.of_body("robot_base")
        place = (0.0, 0.0, 0.0) if entry is None or entry.position is None else entry.position
        turn = (1.0, 0.0, 0.0, 0.0) if entry is None else tuple(entry.orientation)
        if entry is None or entry.position is None:
            scene.account.guessed(
                "place of the robot's base", "the origin of the world",
                remedy="[body.robot_base] position, orientation in the map file",
            )  # fmt: skip
        part = _split(self._joints_at)[1]
        names = tuple(plain(name) for name in rows.joints[part])
        names = names if len(names) == values.shape[1] else ()
        return scene.place_robot("robot_base", still_track(place, turn), values, names=names)

    def _robot(
        self, columns: dict[str, F64], rows: int, scene: SceneBuilder, placed: Placed | None
    ) -> tuple[RobotFrames, tuple[Joint, ...]]:
        parts = {
            name: part_of(columns, spec, None, scene.where)
            for name in ("joint_position", "joint_velocity", "joint_torque", "action", "gripper")
            if (spec := getattr(self._columns, name)) is not None
        }
        if placed is not None:
            parts["joint_position"] = placed.columns
            if "joint_velocity" in parts:
                parts["joint_velocity"] = parts["joint_velocity"] * placed.unit
            return robot_frames(rows, **{"gripper": placed.gripper, **parts}), placed.joints
        count = max(
            (v.shape[1] for name, v in parts.items() if name.startswith("joint")), default=0
        )
        if count:
            scene.account.guessed("names and kinds of joints", "numbered, revolute")
        joints = tuple(Joint(name=f"joint_{i}", kind="revolute") for i in range(count))
        return robot_frames(rows, **parts), joints

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
            reached = part_of(rows.columns, self._columns.success, 1, str(self.path))[:, 0] > 0.5
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


def no_column(map_path: str, column: str, of: str, there: Iterable[str]) -> SourceError:
    """The error for a column that the map file names and the source does not have."""
    return SourceError(map_path, f"[columns] names {column!r}, which is no {of}.", ", ".join(there))


def column_of(text: str) -> str:
    """``"observation.state[3:7]"`` → ``observation.state``."""
    return _split(text)[0]


def part_of(columns: dict[str, F64], text: str, width: int | None, where: str) -> F64:
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
    match = re.fullmatch(r"(.*?)(?:\[(\d+)(?::(\d+))?\])?", text.strip(), re.DOTALL)
    assert match is not None
    if match[2] is None:
        return match[1], slice(None)
    first = int(match[2])
    return match[1], slice(first, int(match[3]) if match[3] else first + 1)


def _track(columns: dict[str, F64], spec: BodyColumns, order: QuaternionOrder, where: str) -> Track:
    """The track of a body by its columns."""
    parts = {
        part: part_of(columns, getattr(spec, part), width, where)
        for part, width in (
            ("position", 3), ("orientation", 4), ("linear_velocity", 3), ("angular_velocity", 3),
        )
        if getattr(spec, part) is not None
    }  # fmt: skip
    turn = to_wxyz(parts["orientation"], order, where)
    return make_track(
        parts["position"], turn, parts.get("linear_velocity"), parts.get("angular_velocity")
    )
