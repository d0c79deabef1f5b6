"""Records one rollout of a SAPIEN scene on the CPU, whoever steps it."""

from __future__ import annotations

import math
import re
from pathlib import Path
from struct import Struct
from typing import Any, Callable, Container

import numpy as np

from .point_log import Row
from .point_recorder import PointRecorder
from .record_error import RecordError
from .rollout_recorder import FRAME_DT
from .scene_parts import describe_body, describe_geom, floats, multiply
from .told_facts import ToldFacts, named_side, names_gripper
from .zip_trace import CONTACT_POINT

_SCENE = re.compile(r"^scene-\d+[-_]")
_QUARTER = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])
"""Turns z to x: PhysX has the axes of capsules, cylinders and normals of planes along x."""

_TOUCH = np.dtype([("numbers", "<f8", 10), ("geoms", "<u2", 2)])
"""Impulse (N s) on the first body, normal to it, position (m), distance (m), and its shapes."""
_pack_touch = Struct("<10d2H").pack
_watchers: list[SapienRecorder] = []
_originals: dict[str, Callable[..., Any]] = {}


class SapienRecorder(PointRecorder):
    """Records one rollout; as a context manager it writes the file at the end of the block.

    A frame is taken after a physics step: poses as they then are, contacts and forces of the step.
    SAPIEN tells the normal forces of contacts and not their friction; the header says so.
    """

    simulator = "SAPIEN"
    force_source = "normal"

    def __init__(
        self,
        scene: Any,
        path: str | Path,
        *,
        frame_dt: float | None = FRAME_DT,
        substeps: bool = True,
        **settings: Any,
    ) -> None:
        """Begin to record; nothing in the scene is changed.

        Args:
            scene: a ``sapien.Scene`` with a ``PhysxCpuSystem``.
            path: a file ending in ``.zip``.
            frame_dt: s; this and the next two as ``RolloutRecorder`` says.
            substeps: look at every physics step.
            settings: roles, kinds, fingers, up, tags, fields of the header. ManiSkill's ``scene-0_`` is left out of
                names.

        Raises:
            RecordError: another ending, physics on a GPU, or a name that is no body's.
        """
        import sapien

        self.physx = scene.physx_system
        if "Cpu" not in type(self.physx).__name__:
            raise RecordError(
                "SAPIEN's physics on a GPU does not list its contacts. Allowed: the CPU; in "
                'ManiSkill make the environment with sim_backend="physx_cpu", num_envs=1.'
            )
        self._list_parts()
        names = [_SCENE.sub("", str(part.entity.name)) for part in self._parts]
        super().__init__(path, names, frame_dt, settings)
        # stored as float32: 0.01 s is 0.00999999978
        self._physics_dt = float(np.format_float_positional(np.float32(self.physx.timestep)))
        self._gravity = floats(self.physx.config.gravity)
        self._version_of_simulator = sapien.__version__
        self._describe(self._told)
        self._take_frame()
        self._looks = substeps
        _watch(type(self.physx), self)

    # ------------------------------------------------------------------ the scene

    def _list_parts(self) -> None:
        """Links first, articulation by articulation, then free bodies, then static ones."""
        physx = self.physx
        self._articulations: list[Any] = []
        self._parts: list[Any] = []
        for link in physx.articulation_link_components:
            whole = link.articulation
            if not any(whole is other or whole == other for other in self._articulations):
                self._articulations.append(whole)
        for whole in self._articulations:
            self._parts += list(whole.links)
        self._links = len(self._parts)
        self._parts += [*physx.rigid_dynamic_components, *physx.rigid_static_components]
        self._by_entity = {part.entity.per_scene_id: i for i, part in enumerate(self._parts)}

    def _describe(self, told: ToldFacts) -> None:
        names, parts = self.body_names, self._parts
        count = len(parts)
        kinds = ["fixture"] * count
        above: list[int | None] = [None] * count
        moves = [False] * count
        # by the user, of the link or of one that it hangs on
        said: list[str | None] = [None] * count
        hinge: list[Any] = [None] * count
        sides: dict[int, str] = {}
        tips: list[int] = []
        self._joints, self._active = [], []
        for whole in self._articulations:
            driven = [joint for joint in whole.active_joints if _is_driven(joint)]
            robot = len(driven) >= 4 or any(names_gripper(link.name) for link in whole.links)
            for link in whole.links:
                i = self._at(link)
                joint = link.joint
                parent = getattr(joint, "parent_link", None)
                above[i] = None if parent is None else self._at(parent)
                up = above[i]
                jointed = joint.type != "fixed" and up is not None
                hinge[i] = joint if jointed else None
                moves[i] = jointed or (moves[up] if up is not None else _is_loose(link))
                if robot:
                    named = names_gripper(names[i]) or (up is not None and kinds[up] == "gripper")
                    kinds[i] = "gripper" if named and up is not None else "robot"
                said[i] = told.kinds.get(i) or (None if up is None else said[up])
                kinds[i] = said[i] or kinds[i]
                if kinds[i] == "gripper":
                    side = named_side(names[i].rpartition("_")[2], joint.name) if jointed else None
                    side = side or (named_side(names[i]) if jointed else None)
                    if side or up in sides:
                        sides[i] = side or sides[up]  # type: ignore[index]
                    if jointed:
                        tips.append(i)
            for joint in whole.active_joints:
                limits = np.asarray(joint.limits, float).reshape(-1, 2)
                bounded = len(limits) == 1 and np.isfinite(limits).all()
                self._joints.append(
                    {
                        "name": _SCENE.sub("", joint.name).replace("/", "_"),
                        "kind": "prismatic" if "prismatic" in joint.type else "revolute",
                        "body": names[self._at(joint.child_link)],
                        "limits": floats(limits[0]) if bounded else None,
                    }
                )
                self._active.append(self._at(joint.child_link))
        if not sides and len(tips) == 2:
            sides, self._sides_guessed = {tips[0]: "left", tips[1]: "right"}, True
        sides = told.fingers or sides
        for i in range(self._links, count):
            dynamic = "Dynamic" in type(parts[i]).__name__
            kinematic = dynamic and parts[i].kinematic
            # what is moved by hand, and bears no shape, is a mark; with a shape it is furniture
            moves[i] = dynamic and not kinematic
            kinds[i] = told.kinds.get(i) or ("object" if moves[i] else "fixture")
        self._bodies = []
        owner: list[int] = []
        self._geom_of: dict[tuple[int, int], int] = {}
        # as long as these objects are held, contacts have the same ones
        self._shapes = [list(part.collision_shapes) for part in parts]
        for i, part in enumerate(parts):
            shapes = [self._geom(shape) for shape in self._shapes[i]]
            for k in range(len(shapes)):
                self._geom_of[i, k] = len(owner) + k
            owner += [i] * len(shapes)
            mass = float(part.mass) if moves[i] or i < self._links else None
            at = part.cmass_local_pose if mass else None
            up = above[i]
            self._bodies.append(
                describe_body(
                    names[i], kinds[i], moves[i], shapes, mass=mass,
                    com=(0.0, 0.0, 0.0) if at is None else at.p,
                    inertia=part.inertia if mass else None,
                    inertia_orientation=(1.0, 0.0, 0.0, 0.0) if at is None else at.q,
                    up=told.ups.get(i), finger=sides.get(i), tags=told.tags.get(i, ()),
                    parent=None if up is None else names[up],
                    excluded=[] if up is None else [names[up]],
                )
            )  # fmt: skip
        self._moving = [i for i in range(count) if moves[i]]
        self._still = [i for i in range(count) if not moves[i]]
        self._geom_by_id = {
            id(shape): self._geom_of[i, k]
            for i, own in enumerate(self._shapes)
            for k, shape in enumerate(own)
        }
        self._mobile = [parts[i] for i in self._moving]
        stands = [parts[i].entity_pose for i in self._still]
        self._stands = (
            np.array([pose.p for pose in stands], float).reshape(-1, 3),
            np.array([pose.q for pose in stands], float).reshape(-1, 4),
        )
        self._owner = owner
        self._fingers = [j for j, i in enumerate(self._active) if i in sides]

    def _at(self, part: Any) -> int:
        return self._by_entity[part.entity.per_scene_id]

    def _geom(self, shape: Any) -> dict[str, Any]:
        kind, pose = type(shape).__name__[len("PhysxCollisionShape") :], shape.local_pose
        material = shape.physical_material
        at: dict[str, Any] = {
            "position": pose.p, "orientation": np.asarray(pose.q, float),
            "friction": (float(material.dynamic_friction), 0.0, 0.0),
        }  # fmt: skip
        if kind == "Sphere":
            return describe_geom("sphere", [shape.radius], **at)
        if kind == "Box":
            return describe_geom("box", shape.half_size, **at)
        if kind in ("Capsule", "Cylinder", "Plane"):
            at["orientation"] = multiply(at["orientation"], _QUARTER)
            size = () if kind == "Plane" else (shape.radius, shape.half_length)
            return describe_geom(kind.lower(), size, **at)
        points = np.asarray(shape.vertices, float) * np.asarray(shape.scale, float)
        if kind == "ConvexMesh":
            return describe_geom("convex_mesh", mesh=self._meshes.keep(points), **at)
        key = self._meshes.keep(points, np.asarray(shape.triangles).reshape(-1, 3))
        return describe_geom("mesh", mesh=key, **at)

    # ------------------------------------------------------------------ frames

    def _watch_no_more(self) -> None:
        _unwatch(self)

    def _take_frame(self) -> None:
        told: list[Any] = []
        for part in self._mobile:
            pose = part.entity_pose
            told += (pose.p, pose.q)
        for whole in self._articulations:
            told += (whole.qpos, whole.qvel, whole.qf)
        self._keep_points(b"".join(told))

    def _points(self, known: Container[Any] = ()) -> list[Row]:
        rows: list[Row] = []
        numbers, owner, dt = self._geom_by_id, self._owner, self._physics_dt
        for contact in self.physx.get_contacts():
            pair = None
            for point in contact.points:
                x, y, z = push = point.impulse.tolist()
                size = math.sqrt(x * x + y * y + z * z) / dt
                if size > 0.0 or point.separation <= 0.0:
                    if pair is None:
                        first, second = (
                            numbers.get(id(shape)) or self._geom_number(part, shape)
                            for part, shape in zip(contact.bodies, contact.shapes)
                        )
                        a, b = owner[first], owner[second]
                        pair = a << 20 | b if a < b else b << 20 | a
                    told = None
                    if pair not in known:
                        told = push, point.normal, point.position, point.separation, first, second
                    rows.append((pair, size, told))
        return rows

    def _geom_number(self, part: Any, shape: Any) -> int:
        """Number of a shape that Python has another object of."""
        body = self._by_entity[part.entity.per_scene_id]
        for k, own in enumerate(self._shapes[body]):
            if own is shape or own == shape:
                return self._geom_of[body, k]
        return self._geom_of[body, 0]

    def _pack_point(self, point: Any) -> bytes:
        push, normal, position, *rest = point
        return _pack_touch(*push, *normal.tolist(), *position.tolist(), *rest)

    def _read_points(self, block: bytes) -> Any:
        told = np.frombuffer(block, _TOUCH)
        points = np.zeros(len(told), CONTACT_POINT)
        numbers = told["numbers"]
        # the impulse is the one on the first body, and the normal points to it
        points["force"] = -numbers[:, :3] / self._physics_dt
        points["normal"], points["position"] = -numbers[:, 3:6], numbers[:, 6:9]
        points["depth"] = -numbers[:, 9]
        points["geom1"], points["geom2"] = told["geoms"].T
        return points

    def _columns(self, frames: list[Any]) -> dict[str, Any]:
        every = np.frombuffer(b"".join(frames), np.float32).reshape(len(frames), -1)
        width = 7 * len(self._mobile)
        poses = every[:, :width].reshape(len(frames), -1, 7)
        parts, at = [], width
        for whole in self._articulations:
            own = every[:, at : at + 3 * whole.dof].reshape(len(frames), 3, -1)
            parts.append(own.swapaxes(1, 2))
            at += 3 * whole.dof
        joints = np.concatenate([np.zeros((len(frames), 0, 3)), *parts], axis=1)
        # PhysX's velocities of what is squeezed or pushed are not those of its motion
        unsaid = np.full(poses[..., :3].shape, np.nan)
        return {
            "position": poses[..., :3],
            "orientation": poses[..., 3:7],
            "linear_velocity": unsaid,
            "angular_velocity": unsaid,
            "joint_position": joints[..., 0],
            "joint_velocity": joints[..., 1],
            "joint_torque": joints[..., 2],
            "gripper": self._opening(joints[..., 0]),
        }

    def _own_remarks(self) -> list[dict[str, str]]:
        return [
            {
                "kind": "missing",
                "what": "friction forces of contacts",
                "cost": "forces are normal forces alone; joint torques are those that were set",
                "remedy": "",
            },
            {
                "kind": "missing",
                "what": "velocities of bodies",
                "cost": "they are derived from poses: PhysX states 0.1 m/s of a cube held still",
                "remedy": "",
            },
        ]


def _is_driven(joint: Any) -> bool:
    return str(joint.type) != "fixed"


def _is_loose(link: Any) -> bool:
    """Whether a root link is fixed to nothing: SAPIEN gives such a joint no fixed type."""
    return str(link.joint.type) not in ("fixed", "undefined")


def _watch(system: Any, recorder: SapienRecorder) -> None:
    """Have every step of a scene tell its recorder."""
    if not _originals:
        step = system.step

        def tell(self: Any) -> None:
            step(self)
            for one in _watchers:
                if one.physx is self or one.physx == self:
                    one.after_step()

        _originals["step"], system.step = step, tell
    _watchers.append(recorder)


def _unwatch(recorder: SapienRecorder) -> None:
    if recorder in _watchers:
        _watchers.remove(recorder)
        if not _watchers:
            type(recorder.physx).step = _originals.pop("step")
