"""LeRobot datasets, v2 and v3, whose map file says which columns hold the poses of which bodies.

LeRobot (github.com/huggingface/lerobot) fixes where images, robot state and actions are, not where
objects are. So nothing is taken for an object's pose by its name: ``[columns.body.NAME]`` says it.

- v2: ``data/chunk-000/episode_000000.parquet``, one file per episode; ``meta/tasks.jsonl``.
- v3: ``data/chunk-000/file-000.parquet``, several episodes per file; ``meta/tasks.parquet``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode, Header, Joint, RobotFrames, Track, still_track
from safestage_eval.errors import InputError, TraceError

from .account import Account
from .gaps import say_bodies, say_contacts, say_success
from .importer import Importer, QuaternionOrder, Settings, SourceError
from .map_tables import ColumnsTable
from .motion import track, wxyz
from .scene import added, dressed, need_shapes
from .stateless import ask_for

F64 = NDArray[np.float64]

OWN = {"index", "frame_index", "episode_index", "timestamp", "task_index"}
"""Columns that every LeRobot table has."""


class LeRobot(Importer):
    """One dataset folder."""

    name = "lerobot"
    title = "LeRobot v2 / v3 dataset"

    def __init__(self, path: Path, settings: Settings) -> None:
        """Read the dataset's description.

        Raises:
            SourceError: no column map, or columns that the dataset does not have.
        """
        super().__init__(path, settings)
        self._info = _info(path) or {}
        features = self._info.get("features")
        self._features: dict[str, Any] = features if isinstance(features, dict) else {}
        if settings.map.columns is None or not settings.map.columns.body:
            raise self._no_map()
        self._columns: ColumnsTable = settings.map.columns

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By ``meta/info.json`` with a ``codebase_version``."""
        info = _info(path)
        if info is None or "codebase_version" not in info:
            return None
        return f"meta/info.json with codebase_version {info['codebase_version']}"

    def _no_map(self) -> SourceError:
        seen = [name for name in self._features if name not in OWN and "image" not in name]
        likely = [n for n in seen if re.search(r"obj|pose|environment_state|body", n)]
        who = f"{self.path} {self._info.get('robot_type', '')}"
        if not likely:
            return SourceError(
                str(self.path),
                "has no poses of objects, only what the robot saw and did "
                f"({', '.join(seen[:8])}).",
                fix=ask_for(who),
            )
        return SourceError(
            str(self.path),
            "does not say which columns are poses of objects.",
            ", ".join(likely),
            '--map FILE with [columns.body.NAME] position = "COLUMN[0:3]", orientation = '
            '"COLUMN[3:7]" (docs/import/lerobot.md)',
        )

    def episodes(self) -> list[str]:
        """``episode_0``, ``episode_1``, … in order."""
        return [f"episode_{number}" for number in sorted(self._files)]

    @cached_property
    def _files(self) -> dict[int, Path]:
        """Episode → the file that holds its rows."""
        import pyarrow.parquet as pq

        found: dict[int, Path] = {}
        for file in sorted((self.path / "data").rglob("*.parquet")):
            name = re.fullmatch(r"episode_(\d+)", file.stem)
            if name is not None:
                found[int(name[1])] = file
                continue
            try:
                numbers = pq.read_table(file, columns=["episode_index"])["episode_index"]
            except (OSError, ValueError, KeyError) as error:
                raise TraceError(str(file), f"cannot be read: {error}") from None
            for number in set(numbers.to_pylist()):
                found[int(number)] = file
        return found

    def fingerprint(self, name: str) -> str:
        """Of the episode's rows in the columns that are mapped."""
        number = _number(name)
        table = self._table(number, name)
        digest = sha256()
        for column in table:
            values = np.ascontiguousarray(table[column])
            digest.update(f"{column} {values.shape}".encode() + values[[0, -1]].tobytes())
        return digest.hexdigest()

    def read(self, name: str, account: Account) -> Episode:
        """One episode."""
        where = f"{self.path}: {name}"
        columns = self._table(_number(name), name)
        order = self._order(where)
        bodies: list[Body] = []
        tracks: dict[str, Track] = {}
        meshes: dict[str, Any] = {}
        assert self._columns.body
        for body_name, spec in self._columns.body.items():
            parts = {
                part: _slice(columns, getattr(spec, part), width, f"{where}: {body_name}")
                for part, width in (
                    ("position", 3), ("orientation", 4), ("linear_velocity", 3),
                    ("angular_velocity", 3),
                )
                if getattr(spec, part) is not None
            }  # fmt: skip
            turn = wxyz(parts["orientation"], order, f"{where}: {body_name}")
            raw = Body(name=body_name, kind="object", untold=("up_axis", "cavity"))
            bodies.append(dressed(raw, self.settings.map, meshes))
            tracks[body_name] = track(
                parts["position"], turn, parts.get("linear_velocity"),
                parts.get("angular_velocity"),
            )  # fmt: skip
        need_shapes(bodies, where, among="LeRobot tables have none")
        if not any(body.kind in ("robot", "gripper") for body in bodies):
            base = Body(name="robot_base", kind="robot", movable=False, mass=0, untold=("links",))
            bodies.append(base)
            tracks[base.name] = still_track((0, 0, 0), (1, 0, 0, 0))
        more, still = added(set(tracks), self.settings.map, meshes)
        t = self._time(columns, where)
        frames, joints = self._robot(columns, len(t), where, account)
        self._told(bodies, account)
        header = self._header(columns, t, _number(name), (*bodies, *more), joints, account)
        return Episode(header, t, {**tracks, **still}, None, frames, meshes=meshes)

    # ---- tables

    def _wanted(self) -> list[str]:
        spec = self._columns
        said = [
            text
            for body in spec.body.values()
            for text in body.model_dump(exclude_none=True).values()
        ]
        said += [v for k, v in spec.model_dump(exclude_none=True).items() if k != "body"]
        return list(dict.fromkeys([_split(text)[0] for text in said]))

    def _table(self, number: int, name: str) -> dict[str, F64]:
        """(T, k) of every mapped column, and of timestamp and task_index."""
        import pyarrow.parquet as pq

        file = self._files.get(number)
        if file is None:
            raise TraceError(f"{self.path}: {name}", "there is no file with its rows")
        schema = pq.read_schema(file)
        wanted = self._wanted()
        missing = [column for column in wanted if column not in schema.names]
        if missing:
            raise SourceError(
                self.settings.map.path or str(self.path),
                f"[columns] names {missing[0]!r}, which is no column of {file.name}.",
                ", ".join(n for n in schema.names if n not in OWN),
            )
        also = [c for c in ("timestamp", "frame_index", "task_index") if c in schema.names]
        read = list(dict.fromkeys([*wanted, *also, "episode_index"]))
        table = pq.read_table(file, columns=[c for c in read if c in schema.names])
        mine = np.ones(len(table), bool)
        if "episode_index" in table.column_names:
            mine = table["episode_index"].to_numpy() == number
        if not mine.any():
            raise TraceError(f"{file}", f"has no rows of episode {number}")
        out = {}
        for column in table.column_names:
            values = table[column].combine_chunks().to_pylist()
            try:
                array = np.asarray(values, np.float64)
            except (ValueError, TypeError):
                raise TraceError(
                    f"{file}: {column}", "rows of different lengths, or no numbers"
                ) from None
            out[column] = array.reshape(len(array), -1)[mine]
        return out

    def _order(self, where: str) -> QuaternionOrder:
        order = self.settings.quaternion or self.settings.map.source.quaternion
        if order is None:
            raise SourceError(
                where,
                "the order of its quaternions is not known: LeRobot prescribes none.",
                "wxyz, xyzw",
                "--quaternion, or [source] quaternion in the map file",
            )
        return order

    def _time(self, columns: dict[str, F64], where: str) -> F64:
        dt = self.settings.dt or self.settings.map.source.dt
        rows = len(next(iter(columns.values())))
        if dt is not None:
            return np.arange(rows, dtype=np.float64) * dt
        if "timestamp" in columns:
            t: F64 = columns["timestamp"][:, 0] - columns["timestamp"][0, 0]
            return t
        fps = self._info.get("fps")
        if not isinstance(fps, int | float) or not fps > 0:
            raise SourceError(
                where, "there is neither a timestamp nor fps in meta/info.json.", fix="--dt TIME"
            )
        return np.arange(rows, dtype=np.float64) / float(fps)

    def _robot(
        self, columns: dict[str, F64], rows: int, where: str, account: Account
    ) -> tuple[RobotFrames, tuple[Joint, ...]]:
        found = []
        for part in ("joint_position", "joint_velocity", "joint_torque", "action", "gripper"):
            spec = getattr(self._columns, part)
            values = np.zeros((rows, 0)) if spec is None else _slice(columns, spec, None, where)
            found.append(values.astype(np.float32))
        count = max(column.shape[1] for column in found[:3])
        if count:
            account.guessed("names and kinds of joints", "numbered, revolute")
        joints = tuple(Joint(name=f"joint_{i}", kind="revolute") for i in range(count))
        return RobotFrames(*found), joints

    # ---- the header and the account

    def _header(
        self,
        columns: dict[str, F64],
        t: F64,
        number: int,
        bodies: tuple[Body, ...],
        joints: tuple[Joint, ...],
        account: Account,
    ) -> Header:
        fps = self._info.get("fps")
        dt = float(np.median(np.diff(t))) if len(t) > 1 else 1 / float(fps or 1)
        physics = self.settings.map.source.physics_dt
        if physics is None:
            account.guessed(
                "physics step", "that of the rows", remedy="[source] physics_dt in the map file"
            )
        success = moment = None
        if self._columns.success is not None:
            reached = _slice(columns, self._columns.success, 1, str(self.path))[:, 0] > 0.5
            success = bool(reached.any())
            moment = float(t[int(np.argmax(reached))]) if success else None
        hold = None if moment is None else float(t[-1] - moment)
        say_success(account, known=success is not None, hold=hold, how="the robot went on")
        task = columns.get("task_index")
        said = None if task is None else self._tasks.get(int(task[0, 0]))
        return Header(
            episode_id="",
            task=said,
            instruction=said,
            rollout=number,
            physics_dt=physics or dt,
            frame_dt=dt,
            control_dt=dt,
            success=success,
            success_time=moment,
            force_source="none",
            bodies=bodies,
            joints=joints,
        )

    @cached_property
    def _tasks(self) -> dict[int, str]:
        """Task index → instruction."""
        return dict(_tasks(self.path / "meta"))

    def _told(self, bodies: list[Body], account: Account) -> None:
        account.missing(
            "bodies that no column is mapped to",
            cost="the robot's distances, contacts and grasps: inconclusive",
            remedy="[columns.body.NAME] in the map file",
        )
        say_bodies(account, bodies, self.settings.map, "the bodies' origins")
        say_contacts(account)
        derived = [n for n, spec in self._columns.body.items() if spec.linear_velocity is None]
        if derived:
            account.recomputed(
                f"velocities of {', '.join(derived)}", "differences of the poses",
                cost="impacts shorter than two rows are smoothed",
            )  # fmt: skip


def _number(name: str) -> int:
    return int(name.removeprefix("episode_"))


def _split(text: str) -> tuple[str, slice]:
    """``"observation.state[3:7]"`` → (``observation.state``, slice(3, 7))."""
    match = re.fullmatch(r"(.*?)(?:\[(\d+)(?::(\d+))?\])?", text.strip(), re.DOTALL)
    assert match is not None
    if match[2] is None:
        return match[1], slice(None)
    first = int(match[2])
    return match[1], slice(first, int(match[3]) if match[3] else first + 1)


def _slice(columns: dict[str, F64], text: str, width: int | None, where: str) -> F64:
    """(T, k) of a column or a part of it. Raises TraceError when it is not ``width`` wide."""
    name, part = _split(text)
    values = columns[name][:, part]
    if width is not None and values.shape[1] != width:
        raise TraceError(
            where, f"{text} has {values.shape[1]} numbers in a row.", f"{width} numbers",
            'name a part of the column: "observation.state[3:7]"',
        )  # fmt: skip
    return values


def _info(path: Path) -> dict[str, Any] | None:
    try:
        found = json.loads((path / "meta" / "info.json").read_text("utf-8"))
    except (OSError, ValueError):
        return None
    return found if isinstance(found, dict) else None


def _tasks(meta: Path) -> Iterator[tuple[int, str]]:
    if (meta / "tasks.jsonl").is_file():
        for line in (meta / "tasks.jsonl").read_text("utf-8").splitlines():
            if line.strip():
                entry = json.loads(line)
                yield int(entry["task_index"]), str(entry["task"])
    elif (meta / "tasks.parquet").is_file():
        import pyarrow.parquet as pq

        for entry in pq.read_table(meta / "tasks.parquet").to_pylist():
            text = entry.get("task", entry.get("__index_level_0__"))
            if text is None:
                raise InputError(str(meta / "tasks.parquet"), "has no column task.")
            yield int(entry["task_index"]), str(text)


IMPORTER = LeRobot
