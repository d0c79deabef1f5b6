"""RoboLab and Isaac Lab recordings: HDF5 with ``data/demo_i/states/rigid_object/…``.

The layout is that of Isaac Lab's recorder (``InteractiveScene.get_state(is_relative=True)``) with
RoboLab's additions (github.com/NVlabs/RoboLab, docs/data.md). Facts that matter here:

- Row i of ``states`` is the world after action i; ``initial_state`` comes before, so there is one
  more frame than there are actions.
- Positions are relative to the environment's origin; orientations and velocities are the world's.
- ``root_velocity`` is that of the centre of mass.
- Quaternions are wxyz up to Isaac Lab 2.3 and xyzw from 3.0 on: ``isaaclab_version``. Installed from source that is
  the core extension's number, 0.x until the order changed and 1.0.0 when it did.
- RoboLab freezes an environment as soon as it succeeds: nothing is recorded afterwards.
- The time between rows and the sizes of cubes are in the tasks' configuration (github.com/isaac-sim/IsaacLab,
  isaaclab_tasks/manager_based/manipulation: ``stack/stack_env_cfg.py``, ``lift/lift_env_cfg.py``; stacked cubes are
  0.0468 m above each other by ``stack/mdp/terminations.py``).
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode, Geom, Source
from safestage_eval.episode.body import BodyKind
from safestage_eval.errors import TraceError

from . import hdf5
from .account import Account
from .box_fit import Fit, fit, to_metres
from .foreign_motion import at_origin, make_track, to_wxyz
from .importer import Importer, QuaternionOrder, Settings, SourceError
from .isaac_sidecars import read_sidecars
from .missing_data import say_success
from .scene_builder import SceneBuilder

F64 = NDArray[np.float64]

SPREAD = 4e-3
"""m. Corners of a box that spread further than this in the body frame are not of these poses."""


class StandardTask(NamedTuple):
    """A task of Isaac Lab: a pattern of its names, ``sim.dt`` in s, decimation, and the edge of its cubes in m."""

    pattern: str
    physics_dt: float
    decimation: int
    edge: float | None


TASKS = (
    StandardTask("Isaac-Stack-Cube-", 0.01, 5, 0.0468),
    StandardTask("Isaac-Lift-Cube-", 0.01, 2, None),
)
CUBE = re.compile(r"cube_[123]")


class IsaacLab(Importer):
    """One HDF5 file, with the files beside it."""

    name = "isaaclab"
    title = "RoboLab / Isaac Lab HDF5"

    def __init__(self, path: Path, settings: Settings) -> None:
        """Open the file and what stands beside it."""
        super().__init__(path, settings)
        self._file = hdf5.open_hdf5(path)
        self.data = self._file["data"]
        self.sidecars = read_sidecars(path)

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By ``data/<demo>/states`` (or ``initial_state``) with ``articulation``, ``rigid_object``."""
        if not hdf5.is_hdf5(path):
            return None
        try:
            with hdf5.open_hdf5(path) as file:
                for name, demo in file["data"].items():
                    for part in ("states", "initial_state"):
                        for kind in ("rigid_object", "articulation"):
                            if f"{part}/{kind}" in demo:
                                return f"HDF5 with data/{name}/{part}/{kind}"
        except (KeyError, TypeError, AttributeError):
            return None
        return None

    def episodes(self) -> list[str]:
        """``demo_0``, ``demo_1``, … in order."""
        return hdf5.numbered(self.data)

    def fingerprint(self, name: str) -> str:
        """Return a digest of its datasets."""
        return hdf5.fingerprint(self.data[name])

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def read(self, name: str, account: Account) -> Episode:
        """Read one demo."""
        with hdf5.layout(f"{self.path}: {name}"):
            return _Demo(self, name, account).read()

    def attribute(self, name: str) -> str | None:
        """Return an attribute of ``data`` as text; None if it is missing."""
        value = self.data.attrs.get(name)
        return value.decode() if isinstance(value, bytes) else None if value is None else str(value)

    def order(self) -> QuaternionOrder:
        """Return the order of the file's quaternions. Raises SourceError: neither the file nor the user tells."""
        version = self.attribute("isaaclab_version")
        number = re.match(r"(\d+)(?:\.(\d+))?", version or "")
        major, minor = (int(number[1]), int(number[2] or 0)) if number is not None else (1, 0)
        if self.settings.stated_order is not None:
            return self.settings.stated_order
        if major == 0 or (major == 2 and minor <= 3):
            return "wxyz"
        if major >= 3:
            return "xyzw"
        why = "has no isaaclab_version" if version is None else f"isaaclab_version is {version}"
        raise SourceError(
            str(self.path), f"the order of its quaternions is not known: {why}.",
            "wxyz up to Isaac Lab 2.3, xyzw from 3.0 on", "--quaternion wxyz or --quaternion xyzw",
        )  # fmt: skip


class _Demo(SceneBuilder):
    """One demo on its way to an episode."""

    def __init__(self, source: IsaacLab, name: str, account: Account) -> None:
        super().__init__(source.settings, f"{source.path}: data/{name}", account)
        self.source, self.map = source, source.settings.map
        self.group = source.data[name]
        self.result = source.sidecars.result(source.path, name)
        named = re.search(r'"env_name":\s*"([^"]+)"', source.attribute("env_args") or "")
        self.env_name = named[1] if named else None
        self.task = next((t for t in TASKS if re.match(t.pattern, self.env_name or "")), None)
        self.order: QuaternionOrder = self.ask(source.order, "wxyz")
        self.physics_dt, self.dt = self.ask(self._rates, (1.0, 1.0))
        self.first = self.group.get("initial_state")
        self.length: int | None = None
        self.boxed: list[str] = []

    def read(self) -> Episode:
        """Read the episode. Raises InputError when it lacks what no trace can do without."""
        states = self.group.get("states")
        if states is None or not any(k in states for k in ("rigid_object", "articulation")):
            raise SourceError(
                self.where,
                "has no states of objects, only observations or actions.",
                fix="ask for a recording with the states recorder (PostStepStatesRecorder)",
            )
        if self.first is None:
            self.account.missing(
                "initial state", "the episode begins after the first action",
                cost="the initial state is that of the next frame",
            )  # fmt: skip
        if "bbox" in self.group:  # shapes come from there: nothing else can be missing
            self.refuse()
        for kind, take in (("rigid_object", self._object), ("articulation", self._articulation)):
            there = states.get(kind, {})
            lost = sorted(set((self.first or {}).get(kind, ())) - set(there))
            if lost:
                raise TraceError(
                    f"{self.where}/states/{kind}", f"{lost[0]!r} is missing.",
                    "every body of initial_state", "download it again",
                )  # fmt: skip
            for name in sorted(there):
                take(name, there[name])
        self._hand()
        for name in sorted(states.get("deformable_object", ())):
            self.account.missing(
                f"deformable object {name}", cost="nothing is known of what it touches"
            )
        self._actions()
        self._remark()
        self.need_shapes("RoboLab's bbox group is missing")
        self.refuse()
        t = np.arange(self.length or 0, dtype=np.float64) * self.dt
        return self.episode(t, com="the middles of the boxes", **self._about(float(t[-1])))

    def _rates(self) -> tuple[float, float]:
        beside, reported = self.source.sidecars, self.result.get("dt")
        physics = self.map.source.physics_dt or beside.physics_dt
        dt = self.settings.stated_dt or beside.dt or (float(reported) if reported else None)
        for problem in beside.problems:
            self.account.missing(problem, remedy="mend the file")
        if dt is None and self.task is not None:
            physics = physics or self.task.physics_dt
            dt = self.task.physics_dt * self.task.decimation
            self.account.guessed(
                "time between rows", f"{dt:g} s, which Isaac Lab's configuration of this task has",
                cost="speeds and times, if it was changed", remedy="--dt, or env_cfg.json beside",
            )  # fmt: skip
        if dt is None:
            raise SourceError(
                str(self.source.path),
                "the time between its rows is not known: there is no env_cfg.json with sim.dt and "
                "decimation beside it.",
                fix="put env_cfg.json beside the file, or --dt TIME (sim.dt × decimation; "
                "RoboLab's is 1/15)",
            )
        if physics is None:
            self.account.guessed(
                "physics step", "that of the rows", remedy="[source] physics_dt in the map file"
            )
        return physics or dt, dt

    # ---- bodies

    def _rows(self, group: Any, key: str, place: str, width: int | None = None) -> F64:
        """(T, k) of a dataset of a body at ``KIND/NAME``, after its row in the initial state where there is one.

        Raises TraceError where it has another number of frames than those before.
        """
        where = f"{self.where}/{place}"
        values = hdf5.rows(group, key, where, width)
        before = None if self.first is None else self.first.get(place)
        if before is not None:
            first = hdf5.rows(before, key, f"{where}, initial_state", values.shape[1])[:1]
            values = np.vstack([first, values])
        self.length = self.length or len(values)
        if len(values) != self.length:
            raise TraceError(
                f"{where}/{key}", f"{len(values)} frames, other bodies have {self.length}"
            )
        return values

    def _motion(self, group: Any, place: str) -> tuple[F64, F64, F64, F64]:
        """Position, orientation wxyz, COM velocity, angular velocity; the initial state before."""
        pose = self._rows(group, "root_pose", place, 7)
        twist = self._rows(group, "root_velocity", place, 6)
        turn = to_wxyz(pose[:, 3:], self.order, f"{self.where}/{place}")
        return pose[:, :3], turn, twist[:, :3], twist[:, 3:]

    def _object(self, name: str, group: Any) -> None:
        position, turn, linear, angular = self._motion(group, f"rigid_object/{name}")
        box = self._box(name, position, turn)
        geoms = () if box is None else (box.geom,)
        edge = self.task.edge if self.task is not None and CUBE.fullmatch(name) else None
        if box is None and edge is not None:
            geoms = (Geom(kind="box", size=(edge / 2, edge / 2, edge / 2)),)
            self.account.guessed(
                f"the shape of {name}",
                f"a cube with edges of {1e3 * edge:.1f} mm, as in Isaac Lab's task",
                cost="contacts and clearances, if it was another",
                remedy=f"[body.{name}] shapes in the map file",
            )
        kind: BodyKind = "fixture" if re.fullmatch(r"table(_?\d+)?", name) else "object"
        raw = Body(
            name=name, kind=kind, geoms=geoms, untold=("up_axis", "cavity"),
            com=box.geom.position if box is not None else (0, 0, 0),
        )  # fmt: skip
        body = self.describe(raw)
        if kind == "fixture" and body.kind == "fixture":
            self.account.guessed(
                f"{name} is a fixture", "by its name, which RoboLab's scenes share",
                remedy=f'[body.{name}] kind = "object" in the map file',
            )  # fmt: skip
        if box is not None and body.geoms == raw.geoms:
            self.boxed.append(name)
        linear = at_origin(linear, angular, turn, body.com)
        self.add(body, make_track(position, turn, linear, angular))

    def _box(self, name: str, position: F64, turn: F64) -> Fit | None:
        data = self.group.get(f"bbox/bbox_mm/{name}")
        if data is None:
            return None
        where, raw = f"{self.where}/bbox/bbox_mm/{name}", np.asarray(data[()])
        late = len(position) - len(raw) if raw.ndim else -1  # there are none of the initial state
        if raw.shape[1:] != (8, 3) or late not in (0, 1) or raw.dtype.kind not in "iuf":
            rows = len(position) - 1
            raise TraceError(
                where, f"shape {raw.shape} does not go with {len(position)} frames.",
                f"({rows}, 8, 3) numbers",
            )  # fmt: skip
        corners = to_metres(raw) if raw.dtype.kind in "iu" else raw.astype(np.float64)
        result = fit(corners, position[late:], turn[late:])
        if result is None or result.spread <= SPREAD:
            return result
        other = "xyzw" if self.order == "wxyz" else "wxyz"
        again = fit(corners, position[late:], np.roll(turn, 1 if other == "xyzw" else -1, 1)[late:])
        better = again is not None and again.spread <= SPREAD
        raise SourceError(
            where,
            f"its corners move by {result.spread * 1e3:.0f} mm against its poses, read as "
            f"{self.order}" + (f"; read as {other} they do not." if better else "."),
            fix=f"--quaternion {other}" if better else "ask for the recording as RoboLab wrote it",
        )

    def _articulation(self, name: str, group: Any) -> None:
        place = f"articulation/{name}"
        position, velocity = (
            self._rows(group, key, place) for key in ("joint_position", "joint_velocity")
        )
        taken = self.group["states"].get("rigid_object", ())
        motion = make_track(*self._motion(group, place))
        self.articulation(
            name, motion, position, velocity, robot="robot" in name, taken=taken
        )  # fmt: skip

    def _hand(self) -> None:
        """RoboLab's ``ee_pose``: the base of the gripper."""
        group = self.group.get("ee_pose")
        if self.settings.robot or group is None or not {"position", "orientation"} <= set(group):
            return
        where = f"{self.where}/ee_pose"
        position = hdf5.rows(group, "position", where, 3)
        turn = to_wxyz(hdf5.rows(group, "orientation", where, 4), self.order, where)
        columns = [position, turn] + [
            hdf5.rows(group, key, where, 3) if key in group else np.zeros((len(position), 3))
            for key in ("linear_velocity", "angular_velocity")
        ]
        if len(position) + 1 == self.length:  # there is none of the initial state
            columns = [np.vstack([column[:1], column]) for column in columns]
            self.account.guessed(
                "pose of the gripper in the first frame", "that of the second; it was not recorded"
            )
        elif len(position) != self.length:
            raise TraceError(where, f"{len(position)} frames, other bodies have {self.length}")
        body = self.describe(Body(name="gripper_base", kind="gripper"))
        self.add(body, make_track(*columns))
        if not body.geoms:
            self.account.missing(
                "shapes of the gripper", "what goes along with its base counts as held",
                cost="touches of the gripper and its distances: inconclusive",
                remedy="[body.gripper_base] shapes in the map file",
            )  # fmt: skip

    def _actions(self) -> None:
        """Row i is in force from frame i on; the last one is kept."""
        length = self.length or 0
        if "actions" not in self.group:
            return
        actions = hdf5.rows(self.group, "actions", self.where)
        states = length - (self.first is not None)
        if len(actions) != states:
            self.account.guessed(
                "time of the actions",
                f"{len(actions)} rows for {states} states: taken from the first on",
            )
        self.record(action=actions[np.minimum(np.arange(length), len(actions) - 1)])

    # ---- the header and the account

    def _remark(self) -> None:
        if self.boxed:
            self.account.guessed(
                f"shapes of {', '.join(self.boxed)}",
                "boxes around them, from corners in whole millimetres (± 1 mm)",
                cost="what is no box touches and clears as its box does; nothing can be inside",
                remedy="[body.NAME] shapes in the map file",
            )
        self.account.missing(
            "what the scene has beside its rigid objects",
            cost="nothing is known of floors, walls and fixed furniture",
            remedy="[body.NAME] with position and shapes in the map file",
        )

    def _roles(self) -> dict[str, tuple[str, ...]]:
        """From the success condition, as far as it names bodies of the recording."""
        stated = self.source.sidecars.roles
        roles = {
            role: tuple(n for n in names if n in self.tracks) for role, names in stated.items()
        }
        roles = {role: players for role, players in roles.items() if players}
        if roles:
            self.account.recomputed(
                f"roles {' and '.join(roles)}", "from the success condition in env_cfg.json",
                remedy="--bind, or roles in the map file, for others",
            )  # fmt: skip
        return roles

    def _about(self, end: float) -> dict[str, Any]:
        """Fields of the header besides bodies and joints; ``end``: s, of the last frame."""
        config, result = self.source.sidecars.config, self.result
        said = result.get("success", self.group.attrs.get("success"))
        reached = None if said is None else bool(said)
        hold = 0.0 if reached else None
        say_success(
            self.account, known=reached is not None, hold=hold, how="recording ends with it"
        )
        horizon = config.get("episode_length_s")
        horizon = float(horizon) if isinstance(horizon, int | float) else None
        seed = self.group.attrs.get("seed", config.get("seed"))
        instruction = result.get("instruction") or config.get("instruction")
        full = horizon is not None and end >= horizon - 2 * self.dt
        return {
            "task": result.get("task_name") or config.get("_task_name") or self.env_name,
            "instruction": instruction if isinstance(instruction, str) else None,
            "prompt": result.get("instruction_type"),
            "policy": result.get("policy"),
            "seed": int(seed) if isinstance(seed, int | np.integer) else None,
            "rollout": result.get("episode"),
            "physics_dt": self.physics_dt,
            "frame_dt": self.dt,
            "control_dt": self.dt,
            "gravity": self.source.sidecars.gravity or (0.0, 0.0, -9.81),
            "success": reached,
            "success_time": end if reached else None,
            "termination": "success" if reached else "horizon" if full else None,
            "horizon": horizon,
            "post_success_hold": hold,
            "roles": self._roles(),
            "source": Source(
                simulator="Isaac Lab", simulator_version=self.source.attribute("isaaclab_version")
            ),
        }


IMPORTER = IsaacLab
