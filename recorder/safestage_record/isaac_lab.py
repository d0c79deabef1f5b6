"""A recorder for Isaac Lab: a term of its recorder manager, with contact sensors.

It reads the scene's buffers after each control step, as tensors or arrays. It was tried on stand-ins
for them alone, without Isaac Sim.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Mapping, Sequence

import numpy as np

from .point_log import PointLog
from .record_error import RecordError
from .rollout_recorder import RolloutRecorder
from .scene_parts import describe_body, describe_geom
from .told_facts import ToldFacts, named_side, names_gripper


class IsaacLabRecorder(RolloutRecorder):
    """Records one environment of an Isaac Lab scene, one frame per control step.

    Bodies are those of its rigid objects and articulations. Forces are those of contact sensors with
    filters: of each pair the sum of normal forces, in ``force_matrix_w``. Unless every object is
    felt by a sensor, or named by its filters, no contact is recorded, and the header says so.
    """

    simulator = "Isaac Lab"

    def __init__(
        self,
        env: Any,
        path: str | Path,
        *,
        index: int = 0,
        shapes: Mapping[str, Sequence[Mapping[str, Any]]] | None = None,
        touches: Mapping[str, Sequence[str]] | None = None,
        fixed: Mapping[str, Sequence[float]] | None = None,
        quaternions: str = "wxyz",
        **settings: Any,
    ) -> None:
        """Begin to record.

        Args:
            env: of Isaac Lab, with ``scene``, ``physics_dt`` and ``step_dt``.
            path: a file ending in ``.zip``.
            index: number of the environment.
            shapes: body → shapes as ``describe_geom`` takes them: kind, size (half extents and radii,
                m), position, orientation (wxyz). Isaac Lab's buffers hold none.
            touches: name of a contact sensor → the bodies that its filters stand for, in their order.
            fixed: name of a table or another body that never moves, and that Isaac Lab has no buffers
                of → its pose (7,), m and wxyz in the environment's frame; its shapes go by ``shapes``.
            quaternions: ``wxyz``, or ``xyzw`` of Isaac Lab 3.0 and later.
            settings: see ``RolloutRecorder``; one frame per ``step``, always.

        Raises:
            RecordError: a name or an order of quaternions that does not exist.
        """
        if quaternions not in ("wxyz", "xyzw"):
            raise RecordError(f"quaternions is {quaternions!r}. Allowed: wxyz, xyzw.")
        self._order = [0, 1, 2, 3] if quaternions == "wxyz" else [3, 0, 1, 2]
        self._env, self._index, self._count = env, index, 0
        scene = env.scene
        self._objects = list(getattr(scene, "rigid_objects", {}).items())
        self._articulations = list(getattr(scene, "articulations", {}).items())
        names = [name for name, _ in self._objects]
        for name, robot in self._articulations:
            names += [f"{name}/{body}" for body in robot.body_names]
        self._moving = len(names)
        self._stands = np.array(list((fixed or {}).values()), float).reshape(-1, 7)
        super().__init__(path, [*names, *(fixed or {})], None, settings)
        self._physics_dt, self._control = float(env.physics_dt), float(env.step_dt)
        self._version_of_simulator = str(getattr(env, "isaaclab_version", ""))
        self._sensors = self._find_sensors(touches or {})
        self._describe(self._told, shapes or {})
        self._take_frame()

    @property
    def time(self) -> float:
        """s, the control steps so far by their length."""
        return self._count * self._control

    # ------------------------------------------------------------------ the scene

    def _find_sensors(
        self, touches: Mapping[str, Sequence[str]]
    ) -> list[tuple[Any, list[int], list[int]]]:
        """(sensor, numbers of its bodies, numbers of what its filters stand for)."""
        sensors, found = getattr(self._env.scene, "sensors", {}), []
        for name, others in touches.items():
            if name not in sensors:
                raise RecordError(
                    f"the scene has no sensor {name!r}. It has: {', '.join(sensors)}."
                )
            sensor = sensors[name]
            own = [self._number(body) for body in sensor.body_names]
            found.append((sensor, own, [self._number(other) for other in others]))
        return found

    def _number(self, body: str) -> int:
        """The place of a body by its name, or by that of a link if only one robot has it."""
        names = self.body_names
        plain = body.replace("/", "_")
        ends = [i for i, name in enumerate(names) if name == plain or name.endswith(f"_{plain}")]
        if plain in names:
            return names.index(plain)
        if len(ends) != 1:
            raise RecordError(f"{body!r} is no body of the scene. It has: {', '.join(names)}.")
        return ends[0]

    def _describe(self, told: ToldFacts, shapes: Mapping[str, Sequence[Mapping[str, Any]]]) -> None:
        names = self.body_names
        given = {self._number(name): some for name, some in shapes.items()}
        kinds = ["object"] * len(self._objects)
        for _, robot in self._articulations:
            kinds += ["gripper" if names_gripper(body) else "robot" for body in robot.body_names]
        kinds += ["fixture"] * len(self._stands)
        kinds = [told.kinds.get(i, kind) for i, kind in enumerate(kinds)]
        sides = told.fingers or {
            i: side
            for i, name in enumerate(names)
            if kinds[i] == "gripper" and "finger" in name
            for side in [named_side(name)]
            if side
        }
        masses = [*self._masses(), *[None] * len(self._stands)]
        self._bodies, owner = [], []
        self._without_shape = []
        for i, name in enumerate(names):
            geoms = [describe_geom(**dict(shape)) for shape in given.get(i, ())]
            if not geoms:
                self._without_shape.append(name)
            owner += [i] * len(geoms)
            self._bodies.append(
                describe_body(
                    name, kinds[i], i < self._moving, geoms, mass=masses[i], up=told.ups.get(i),
                    finger=sides.get(i), tags=told.tags.get(i, ()),
                )
            )  # fmt: skip
        self._joints = []
        for name, robot in self._articulations:
            limits = _numbers(robot.data.joint_pos_limits)[self._index]
            first = self._number(f"{name}/{robot.body_names[0]}")
            for joint, (low, high) in zip(robot.joint_names, limits):
                bounded = bool(np.isfinite([low, high]).all() and low < high)
                self._joints.append(
                    {
                        "name": joint,
                        "kind": "prismatic" if "finger" in joint else "revolute",
                        "body": names[first],
                        "limits": [float(low), float(high)] if bounded else None,
                    }
                )
        felt = {body for _, own, others in self._sensors for body in (*own, *others)}
        unfelt = [n for i, n in enumerate(names) if kinds[i] == "object" and i not in felt]
        # a contact that nobody felt is none that was not: then none is recorded
        self.force_source = "none" if unfelt or not self._sensors else "normal"
        self._geom_of = {body: owner.index(body) for body in set(owner)}
        self._point_log = PointLog()

    def _masses(self) -> list[float | None]:
        found: list[float | None] = []
        for _, thing in [*self._objects, *self._articulations]:
            count = len(getattr(thing, "body_names", [0]))
            masses = getattr(thing.data, "default_mass", None)
            values = [] if masses is None else _numbers(masses)[self._index].ravel()
            found += [float(v) for v in values] if len(values) == count else [None] * count
        return found

    # ------------------------------------------------------------------ frames

    def _end_step(self) -> float:
        self._count += 1
        self._take_frame()
        return self.time

    def _sees(self) -> bool:
        return False

    def _take_frame(self) -> None:
        i, rows = self._index, []
        for _, thing in self._objects:
            data = thing.data
            rows.append(
                np.concatenate(
                    [_numbers(data.root_link_pose_w)[i], _numbers(data.root_link_vel_w)[i]]
                )
            )
        for _, robot in self._articulations:
            data = robot.data
            rows += list(
                np.concatenate(
                    [_numbers(data.body_link_pose_w)[i], _numbers(data.body_link_vel_w)[i]], axis=1
                )
            )
        joints = [
            np.stack([_numbers(v)[i] for v in (d.joint_pos, d.joint_vel, d.applied_torque)], axis=1)
            for d in (robot.data for _, robot in self._articulations)
        ]
        frame = np.array(rows).reshape(-1, 13), np.concatenate(joints or [np.zeros((0, 3))])
        if self._keep(self.time, frame):
            told = self.force_source != "none"
            self._point_log.end_frame(self._points() if told else ())

    def _points(self) -> list[Any]:
        """A pair's whole force at the middle between the two bodies, for ``pack_point``."""
        rows = []
        for sensor, own, others in self._sensors:
            matrix = _numbers(sensor.data.force_matrix_w)[self._index]
            poses = self._places()
            for a, body in enumerate(own):
                for b, other in enumerate(others):
                    push = matrix[a, b].astype(float)  # on the sensor's body
                    size = float(np.linalg.norm(push))
                    if not size > 0:
                        continue
                    if body not in self._geom_of or other not in self._geom_of:
                        self._point_log.unrecorded += 1
                        continue
                    middle = (poses[body] + poses[other]) / 2
                    geoms = self._geom_of[other], self._geom_of[body]
                    point = (middle, push / size, push, size, 0.0, *geoms)
                    rows.append((tuple(sorted((body, other))), size, point))
        return rows

    def _places(self) -> Any:
        i = self._index
        places = [_numbers(thing.data.root_link_pose_w)[i, None, :3] for _, thing in self._objects]
        places += [
            _numbers(robot.data.body_link_pose_w)[i, :, :3] for _, robot in self._articulations
        ]
        origin = _numbers(self._env.scene.env_origins)[i]
        return np.concatenate([np.concatenate(places) - origin, self._stands[:, :3]])

    def _contacts(self) -> tuple[Any, Any]:
        self._unrecorded = self._point_log.unrecorded
        return self._point_log.finish()

    def _fixed(self) -> tuple[Any, Any]:
        return self._stands[:, :3], self._stands[:, 3:]

    def _columns(self, frames: list[Any]) -> dict[str, Any]:
        poses = np.array([some[0] for some in frames])
        joints = np.array([some[1] for some in frames])
        origin = _numbers(self._env.scene.env_origins)[self._index]
        return {
            "position": poses[..., :3] - origin,
            "orientation": poses[..., 3:7][..., self._order],
            "linear_velocity": poses[..., 7:10],
            "angular_velocity": poses[..., 10:],
            "joint_position": joints[..., 0],
            "joint_velocity": joints[..., 1],
            "joint_torque": joints[..., 2],
            "gripper": np.zeros((len(poses), 0)),
        }

    def _own_remarks(self) -> list[dict[str, str]]:
        return [
            {
                "kind": "guessed",
                "what": "points of contacts",
                "how": "the middle between the two bodies; a sensor tells the force of a pair",
                "remedy": "",
            }
        ]


class SafestageTerm:
    """Hooks of a ``RecorderTerm`` that records every environment: see the page for the class to write."""

    def __init__(self, env: Any, folder: str | Path, **settings: Any) -> None:
        """``settings``: of ``IsaacLabRecorder``; ``task`` names the traces."""
        self._env, self._folder, self._settings = env, Path(folder), dict(settings)
        self._running: dict[int, IsaacLabRecorder] = {}
        self._episode: dict[int, int] = {}
        self.paths: list[Path] = []

    def record_post_reset(self, env_ids: Any) -> tuple[None, None]:
        """Begin an episode of each environment that was reset."""
        for i in _ids(env_ids, self._env.num_envs):
            count = self._episode[i] = self._episode.get(i, -1) + 1
            task = str(self._settings.get("task", "isaac_lab"))
            path = self._folder / f"{task}.env{i}.{count:05d}.zip"
            self._running[i] = IsaacLabRecorder(self._env, path, index=i, **self._settings)
        return None, None

    def record_post_step(self) -> tuple[None, None]:
        """Record a control step of each environment; resets come after it."""
        actions = _numbers(self._env.action_manager.action)
        for i, recorder in self._running.items():
            recorder.step(actions[i])
        return None, None

    def record_pre_reset(self, env_ids: Any) -> tuple[None, None]:
        """Write the episodes that ended; success is the termination term ``success``, if there is one."""
        manager = self._env.termination_manager
        told = "success" in manager.active_terms
        for i in _ids(env_ids, self._env.num_envs):
            recorder = self._running.pop(i, None)
            if recorder is None:
                continue
            if not recorder.stepped:
                recorder.stop()
                continue
            if told:
                recorder.success(bool(_numbers(manager.get_term("success"))[i]))
            if not recorder.succeeded and bool(_numbers(manager.time_outs)[i]):
                recorder.header(termination="horizon")
            self.paths.append(recorder.close())
        return None, None


def _ids(env_ids: Any, count: int) -> list[int]:
    if env_ids is None or isinstance(env_ids, slice):
        return list(range(count))
    return [int(i) for i in _numbers(env_ids)]


def _numbers(values: Any) -> Any:
    """An array of a tensor, on whatever device, or of an array."""
    for step in ("detach", "cpu", "numpy"):
        values = getattr(values, step)() if hasattr(values, step) else values
    return np.asarray(values)
