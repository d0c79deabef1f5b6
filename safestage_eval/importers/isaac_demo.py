"""One demo of a RoboLab or Isaac Lab recording on its way to an episode."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode, Source
from safestage_eval.episode.body import BodyKind
from safestage_eval.errors import TraceError

from . import hdf5
from .account import Account
from .box_fit import Fit, fit, to_metres
from .foreign_motion import at_origin, fixed_if_still, make_track, to_wxyz
from .importer import QuaternionOrder, SourceError
from .isaac_file import IsaacFile
from .isaac_robot import robot_columns, rows_with_first
from .isaac_tasks import standard_task
from .missing_data import say_links, say_success
from .place_robot import Placed
from .scene_builder import SceneBuilder

F64 = NDArray[np.float64]

SPREAD = 4e-3
"""m. Corners of a box that spread further than this in the body frame are not of these poses."""


class Demo(SceneBuilder):
    """One demo on its way to an episode."""

    def __init__(self, source: IsaacFile, name: str, account: Account) -> None:
        super().__init__(source.settings, f"{source.path}: data/{name}", account)
        self.source, self.name, self.map = source, name, source.settings.map
        self.group = source.data[name]
        self.result = source.sidecars.result(source.path, name)
        self.task = standard_task(_env_name(source))
        self.order: QuaternionOrder = self.gaps.ask(source.order, "wxyz")
        self.physics_dt, self.dt = self.gaps.ask(self._rates, (1.0, 1.0))
        self.first = self.group.get("initial_state")
        self.placed: dict[str, Placed] = {}
        self.cubes: set[str] = set()

    def read(self) -> Episode:
        """Read the episode. Raises InputError when it lacks what no trace can do without."""
        states = self.group.get("states")
        if states is None or not any(k in states for k in ("rigid_object", "articulation")):
            raise SourceError(
                self.where,
                "has no states of objects, only observations or actions.",
                fix="ask for a recording with the states recorder (PostStepStatesRecorder)",
            )
        self._need_all(states)
        if "bbox" in self.group:  # shapes come from there: nothing else can be missing
            self.gaps.refuse()
        for name in sorted(states.get("rigid_object", ())):
            self._object(name, states["rigid_object"][name])
        for name in sorted(states.get("articulation", ())):
            self._articulation(name, states["articulation"][name])
        self._hand()
        for name in sorted(states.get("deformable_object", ())):
            self.account.missing(
                f"deformable object {name}", cost="nothing is known of what it touches"
            )
        frames, joints = robot_columns(
            self.group, self.length, self.where, self.account, self.placed
        )
        self._remark()
        self.need_shapes("RoboLab's bbox group is missing")
        self.gaps.refuse()
        t = np.arange(self.length, dtype=np.float64) * self.dt
        com = "the middles of the boxes"
        return self.episode(t, frames, com=com, joints=joints, **self._about())

    # ---- rates

    def _rates(self) -> tuple[float, float]:
        beside, reported = self.source.sidecars, self.result.get("dt")
        physics = self.map.source.physics_dt or beside.physics_dt
        dt = self.settings.stated_dt or beside.dt or (float(reported) if reported else None)
        for problem in beside.problems:
            self.account.missing(problem, remedy="mend the file")
        if dt is None and self.task is not None:
            dt, physics = self.task.dt, physics or self.task.physics_dt
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
            physics = dt
            self.account.guessed(
                "physics step", "that of the rows", remedy="[source] physics_dt in the map file"
            )
        return physics, dt

    # ---- bodies

    def _motion(self, group: Any, first: Any, name: str) -> tuple[F64, F64, F64, F64]:
        """Position, orientation wxyz, COM velocity, angular velocity; the initial state before."""
        where = f"{self.where}/{name}"
        pose = rows_with_first(group, first, "root_pose", where, 7)
        twist = rows_with_first(group, first, "root_velocity", where, 6)
        self._same_length(len(pose), where)
        return pose[:, :3], to_wxyz(pose[:, 3:], self.order, where), twist[:, :3], twist[:, 3:]

    def _same_length(self, rows: int, where: str) -> None:
        self.length = getattr(self, "length", rows)
        if rows != self.length:
            raise TraceError(where, f"{rows} frames, other bodies have {self.length}")

    def _need_all(self, states: Any) -> None:
        """Raises TraceError when a body of the initial state has no later ones."""
        if self.first is None:
            return
        for kind in ("rigid_object", "articulation"):
            lost = sorted(set(self.first.get(kind, ())) - set(states.get(kind, ())))
            if lost:
                raise TraceError(
                    f"{self.where}/states/{kind}", f"{lost[0]!r} is missing.",
                    "every body of initial_state", "download it again",
                )  # fmt: skip

    def _initial(self, kind: str, name: str) -> Any:
        """The group of a body in ``initial_state``, if that is there."""
        result = None if self.first is None else self.first.get(f"{kind}/{name}")
        if result is None:
            self.account.missing(
                "initial state", "the episode begins after the first action",
                cost="the initial state is that of the next frame",
            )  # fmt: skip
        return result

    def _object(self, name: str, group: Any) -> None:
        position, orientation, linear, angular = self._motion(
            group, self._initial("rigid_object", name), name
        )
        box = self._box(name, position, orientation)
        cube = self.task.cube(name) if self.task is not None and box is None else None
        if cube is not None:
            self.cubes.add(name)
            self.account.guessed(
                f"the shape of {name}",
                f"a cube with edges of {2e3 * cube.size[0]:.1f} mm, as in Isaac Lab's task",
                cost="contacts and clearances, if it was another",
                remedy=f"[body.{name}] shapes in the map file",
            )
        kind: BodyKind = "fixture" if re.fullmatch(r"table(_?\d+)?", name) else "object"
        raw = Body(
            name=name, kind=kind, geoms=(box.geom,) if box else (cube,) if cube else (),
            com=box.geom.position if box is not None else (0, 0, 0),
            untold=("up_axis", "cavity"),
        )  # fmt: skip
        body = self.describe(raw)
        if kind == "fixture" and body.kind == "fixture":
            self.account.guessed(
                f"{name} is a fixture", "by its name, which RoboLab's scenes share",
                remedy=f'[body.{name}] kind = "object" in the map file',
            )  # fmt: skip
        linear = at_origin(linear, angular, orientation, body.com)
        self.add(body, make_track(position, orientation, linear, angular))

    def _box(self, name: str, position: F64, orientation: F64) -> Fit | None:
        data = self.group.get(f"bbox/bbox_mm/{name}")
        if data is None:
            return None
        raw = np.asarray(data[()])
        if raw.ndim != 3 or raw.dtype.kind not in "iuf":
            raise TraceError(
                f"{self.where}/bbox/bbox_mm/{name}", f"shape {raw.shape}.", "(T, 8, 3) numbers"
            )
        corners = to_metres(raw) if np.issubdtype(raw.dtype, np.integer) else raw.astype(np.float64)
        late = len(position) - len(corners)  # there are none of the initial state
        if corners.shape[1:] != (8, 3) or late not in (0, 1):
            raise TraceError(
                f"{self.where}/bbox/bbox_mm/{name}",
                f"shape {corners.shape} does not go with {len(position)} frames.",
                f"({len(position) - 1}, 8, 3)",
            )
        result = fit(corners, position[late:], orientation[late:])
        if result is not None and result.spread > SPREAD:
            other = "xyzw" if self.order == "wxyz" else "wxyz"
            turned = (
                orientation[:, [1, 2, 3, 0]] if other == "wxyz" else orientation[:, [3, 0, 1, 2]]
            )
            again = fit(corners, position[late:], turned[late:])
            better = again is not None and again.spread <= SPREAD
            raise SourceError(
                f"{self.where}/bbox/bbox_mm/{name}",
                f"its corners move by {result.spread * 1e3:.0f} mm against its poses, read as "
                f"{self.order}" + (f"; read as {other} they do not." if better else "."),
                fix=f"--quaternion {other}" if better
                else "ask for the recording as RoboLab wrote it",
            )  # fmt: skip
        return result

    def _articulation(self, name: str, group: Any) -> None:
        first = self._initial("articulation", name)
        position, orientation, linear, angular = self._motion(group, first, name)
        own = f"{name}_base" if name in ("robot", "gripper") else name
        raw = Body(name=own, kind="robot" if "robot" in name else "fixture", untold=("links",))
        body = self.describe(raw)
        body, motion = fixed_if_still(body, make_track(position, orientation, linear, angular))
        if raw.kind == "robot" and self.settings.robot is not None:
            columns = rows_with_first(group, first, "joint_position", f"{self.where}/{name}")
            taken = self.group["states"].get("rigid_object", ())
            placed = self.place_robot(own, motion, columns, taken=taken)
            assert placed is not None
            self.placed[name] = placed
            return
        self.add(body, motion)
        say_links(self.account, name)

    def _hand(self) -> None:
        """RoboLab's ``ee_pose``: the base of the gripper."""
        group = self.group.get("ee_pose")
        if self.placed or group is None or not {"position", "orientation"} <= set(group):
            return
        where = f"{self.where}/ee_pose"
        position = hdf5.rows(group, "position", where, 3)
        turn = to_wxyz(hdf5.rows(group, "orientation", where, 4), self.order, where)
        twist = [
            hdf5.rows(group, key, where, 3) if key in group else None
            for key in ("linear_velocity", "angular_velocity")
        ]
        if len(position) == self.length - 1:  # there is none of the initial state
            position, turn = np.vstack([position[:1], position]), np.vstack([turn[:1], turn])
            twist = [None if v is None else np.vstack([0 * v[:1], v]) for v in twist]
            self.account.guessed(
                "pose of the gripper in the first frame", "that of the second; it was not recorded"
            )
        self._same_length(len(position), where)
        raw = Body(name="gripper_base", kind="gripper")
        body = self.describe(raw)
        self.add(body, make_track(position, turn, *twist))
        if not body.geoms:
            self.account.missing(
                "shapes of the gripper", "what goes along with its base counts as held",
                cost="touches of the gripper and its distances: inconclusive",
                remedy="[body.gripper_base] shapes in the map file",
            )  # fmt: skip

    # ---- the header and the account

    def _remark(self) -> None:
        mapped = {name for name in self.tracks if (b := self.map.of_body(name)) and b.shapes}
        placed = ("robot", "gripper")  # with the shapes of a description
        boxed = [
            b.name for b in self.bodies
            if b.geoms and b.name not in {*mapped, *self.cubes} and b.kind not in placed
        ]  # fmt: skip
        if boxed:
            self.account.guessed(
                f"shapes of {', '.join(boxed)}",
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
        there = {body.name for body in self.bodies}
        roles = {role: tuple(n for n in players if n in there) for role, players in stated.items()}
        roles = {role: players for role, players in roles.items() if players}
        if roles:
            self.account.recomputed(
                f"roles {' and '.join(roles)}", "from the success condition in env_cfg.json",
                remedy="--bind, or roles in the map file, for others",
            )  # fmt: skip
        return roles

    def _about(self) -> dict[str, Any]:
        """Fields of the header besides bodies and joints."""
        config, result = self.source.sidecars.config, self.result
        success = self.group.attrs.get("success")
        recorded_success = result.get("success")
        reached = bool(recorded_success if recorded_success is not None else success) if (
            recorded_success is not None or success is not None
        ) else None  # fmt: skip
        end = float((self.length - 1) * self.dt)
        say_success(
            self.account, known=reached is not None, hold=0.0 if reached else None,
            how="recording ends with it",
        )  # fmt: skip
        horizon = config.get("episode_length_s")
        seed = self.group.attrs.get("seed", config.get("seed"))
        instruction = result.get("instruction") or config.get("instruction")
        full = isinstance(horizon, int | float) and end >= float(horizon) - 2 * self.dt
        version = self.source.attribute("isaaclab_version")
        return {
            "task": result.get("task_name") or config.get("_task_name") or _env_name(self.source),
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
            "horizon": float(horizon) if isinstance(horizon, int | float) else None,
            "post_success_hold": 0.0 if reached else None,
            "roles": self._roles(),
            "source": Source(
                simulator="Isaac Lab", simulator_version=None if version is None else str(version)
            ),
        }


def _env_name(source: IsaacFile) -> str | None:
    """From ``env_args``, or the name of the folder."""
    match = re.search(r'"env_name":\s*"([^"]+)"', str(source.attribute("env_args") or ""))
    return match[1] if match else None
