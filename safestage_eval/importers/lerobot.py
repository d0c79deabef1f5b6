"""LeRobot datasets, v2 and v3; the map file assigns columns to the poses of bodies.

LeRobot (github.com/huggingface/lerobot) fixes where images, robot state and actions are, not where
objects are. So nothing is taken for an object's pose by its name: ``[columns.body.NAME]`` says it.
"""

from __future__ import annotations

import re
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode, Header, Joint, RobotFrames, Track, still_track

from .account import Account
from .foreign_motion import make_track, to_wxyz
from .gaps import Gaps
from .importer import Importer, QuaternionOrder, Settings, SourceError
from .lerobot_tables import OWN, Tables, column_of, described, part_of
from .map_tables import ColumnsTable
from .missing_data import say_bodies, say_contacts, say_success
from .place_robot import Placed, place_robot
from .scene_bodies import apply_map, fixed_from_map, need_shapes
from .stateless import ask_for

F64 = NDArray[np.float64]


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
        self._info = described(path) or {}
        self._tables = Tables(path)
        features = self._info.get("features")
        self._features: dict[str, Any] = features if isinstance(features, dict) else {}
        if settings.map.columns is None or not settings.map.columns.body:
            raise self._no_map()
        self._columns: ColumnsTable = settings.map.columns

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By ``meta/info.json`` with a ``codebase_version``."""
        info = described(path)
        if info is None or "codebase_version" not in info:
            return None
        return f"meta/info.json with codebase_version {info['codebase_version']}"

    @classmethod
    def columns_of(cls, path: Path) -> list[str]:
        """Columns of numbers, with how many each row has."""
        features = (described(path) or {}).get("features")
        table = features if isinstance(features, dict) else {}
        plain = {n: f for n, f in table.items() if n not in OWN and isinstance(f, dict)}
        return [
            f"{name}[0:{shape[0]}]" if len(shape := f.get("shape") or []) == 1 else name
            for name, f in plain.items()
            if str(f.get("dtype", "")).startswith(("float", "int", "bool"))
        ]

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
        return [f"episode_{number}" for number in sorted(self._tables.files)]

    def fingerprint(self, name: str) -> str:
        """Digest of the episode's rows in the mapped columns."""
        table = self._tables.read(_number(name), self._wanted(), self._map_path)
        digest = sha256()
        for column in table:
            values = np.ascontiguousarray(table[column])
            digest.update(f"{column} {values.shape}".encode() + values[[0, -1]].tobytes())
        return digest.hexdigest()

    def read(self, name: str, account: Account) -> Episode:
        """Read one episode."""
        where = f"{self.path}: {name}"
        columns = self._tables.read(_number(name), self._wanted(), self._map_path)
        gaps = Gaps(where, self.settings.noted)
        order: QuaternionOrder = gaps.ask(lambda: self._order(where), "wxyz")
        bodies: list[Body] = []
        tracks: dict[str, Track] = {}
        meshes: dict[str, Any] = {}
        assert self._columns.body
        for body_name, spec in self._columns.body.items():
            parts = {
                part: part_of(columns, getattr(spec, part), width, f"{where}: {body_name}")
                for part, width in (
                    ("position", 3), ("orientation", 4), ("linear_velocity", 3),
                    ("angular_velocity", 3),
                )
                if getattr(spec, part) is not None
            }  # fmt: skip
            turn = to_wxyz(parts["orientation"], order, f"{where}: {body_name}")
            raw = Body(name=body_name, kind="object", untold=("up_axis", "cavity"))
            bodies.append(apply_map(raw, self.settings.map, meshes))
            tracks[body_name] = make_track(
                parts["position"], turn, parts.get("linear_velocity"),
                parts.get("angular_velocity"),
            )  # fmt: skip
        gaps.ask(lambda: need_shapes(bodies, where, among="LeRobot tables have none"), None)
        t = gaps.ask(lambda: self._time(columns, where), np.zeros(0))
        gaps.refuse()
        placed = self._placed(columns, where, set(tracks), account, meshes)
        if placed is not None:
            bodies += placed.bodies
            tracks.update(placed.tracks)
        elif not any(body.kind in ("robot", "gripper") for body in bodies):
            base = Body(name="robot_base", kind="robot", movable=False, mass=0, untold=("links",))
            bodies.append(base)
            tracks[base.name] = still_track((0, 0, 0), (1, 0, 0, 0))
        more, still = fixed_from_map(set(tracks), self.settings.map, meshes)
        frames, joints = self._robot(columns, len(t), where, account, placed)
        self._remark(bodies, account)
        header = self._header(columns, t, _number(name), (*bodies, *more), joints, account)
        return Episode(header, t, {**tracks, **still}, None, frames, meshes=meshes)

    @property
    def _map_path(self) -> str:
        return self.settings.map.path or str(self.path)

    def _wanted(self) -> list[str]:
        """Names of the mapped columns."""
        spec = self._columns
        texts = [
            text
            for body in spec.body.values()
            for text in body.model_dump(exclude_none=True).values()
        ]
        texts += [v for k, v in spec.model_dump(exclude_none=True).items() if k != "body"]
        return list(dict.fromkeys([column_of(text) for text in texts]))

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

    def _placed(
        self,
        columns: dict[str, F64],
        where: str,
        taken: set[str],
        account: Account,
        meshes: dict[str, Any],
    ) -> Placed | None:
        """The robot's links by ``--robot`` and the joint positions; its base stands at the world's origin."""
        spec = self._columns.joint_position
        if self.settings.robot is None:
            return None
        if spec is None:
            raise SourceError(
                where, "no column is mapped to the joint positions, which --robot needs.",
                fix='[columns] joint_position = "observation.state[0:7]" in the map file',
            )  # fmt: skip
        values = part_of(columns, spec, None, where)
        entry = self.settings.map.of_body("robot_base")
        place = (0.0, 0.0, 0.0) if entry is None or entry.position is None else entry.position
        turn = (1.0, 0.0, 0.0, 0.0) if entry is None else tuple(entry.orientation)
        if entry is None or entry.position is None:
            account.guessed(
                "place of the robot's base", "the origin of the world",
                remedy="[body.robot_base] position, orientation in the map file",
            )  # fmt: skip
        feature = self._features.get(column_of(spec), {})
        names = feature.get("names") if isinstance(feature, dict) else None
        names = next(iter(names.values()), None) if isinstance(names, dict) else names
        named = (
            [str(name).removesuffix(".pos") for name in names] if isinstance(names, list) else []
        )
        return place_robot(
            self.settings, "robot_base", still_track(place, turn), values, account, meshes,
            names=named if len(named) == values.shape[1] else (), taken=taken,
        )  # fmt: skip

    def _robot(
        self,
        columns: dict[str, F64],
        rows: int,
        where: str,
        account: Account,
        placed: Placed | None,
    ) -> tuple[RobotFrames, tuple[Joint, ...]]:
        parts = []
        for part in ("joint_position", "joint_velocity", "joint_torque", "action", "gripper"):
            spec = getattr(self._columns, part)
            values = np.zeros((rows, 0)) if spec is None else part_of(columns, spec, None, where)
            parts.append(values.astype(np.float32))
        count = max(column.shape[1] for column in parts[:3])
        if placed is not None:
            if not parts[-1].shape[1]:
                parts[-1] = placed.gripper.astype(np.float32)
            return RobotFrames(*parts), placed.joints
        if count:
            account.guessed("names and kinds of joints", "numbered, revolute")
        joints = tuple(Joint(name=f"joint_{i}", kind="revolute") for i in range(count))
        return RobotFrames(*parts), joints

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
            reached = part_of(columns, self._columns.success, 1, str(self.path))[:, 0] > 0.5
            success = bool(reached.any())
            moment = float(t[int(np.argmax(reached))]) if success else None
        hold = None if moment is None else float(t[-1] - moment)
        say_success(account, known=success is not None, hold=hold, how="the robot went on")
        task = columns.get("task_index")
        instruction = None if task is None else self._tables.tasks.get(int(task[0, 0]))
        return Header(
            episode_id="",
            task=instruction,
            instruction=instruction,
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

    def _remark(self, bodies: list[Body], account: Account) -> None:
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


IMPORTER = LeRobot
