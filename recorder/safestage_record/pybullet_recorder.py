"""Records one rollout of a PyBullet simulation, whoever steps it."""

from __future__ import annotations

from array import array
from pathlib import Path
from typing import Any, Callable, Container, Mapping, Sequence

import numpy as np

from .bullet_touches import BulletTouches, read_touches
from .link_tree import Hinge, LinkTree, Motion
from .mesh_files import read_hulls
from .point_log import Row
from .point_recorder import PointRecorder
from .record_error import RecordError
from .rollout_recorder import FRAME_DT
from .scene_parts import cross, describe_body, describe_geom, multiply, turn
from .told_facts import ToldFacts, named_side, names_gripper

_XYZW = [3, 0, 1, 2]
_STILL = (0.0,) * 6
_SAME, _NEAR = 1e-6, 1e-4
"""m, by how much a link may be elsewhere than its joint puts it; what PyBullet tells of joints is rounded to 32 bits."""
_KINDS = {2: "sphere", 3: "box", 4: "cylinder", 5: "mesh", 6: "plane", 7: "capsule"}
_watchers: dict[int, PyBulletRecorder] = {}
_originals: dict[str, Callable[..., Any]] = {}


class PyBulletRecorder(PointRecorder):
    """Records one rollout; as a context manager it writes the file at the end of the block.

    A frame is taken after a physics step: poses as they then are, contacts and forces of the step.
    """

    simulator = "PyBullet"

    def __init__(
        self,
        client: Any,
        path: str | Path,
        *,
        names: Mapping[int, str] | None = None,
        frame_dt: float | None = FRAME_DT,
        substeps: bool = True,
        **settings: Any,
    ) -> None:
        """Begin to record; nothing in the simulation is changed.

        Args:
            client: number of the physics client, or a ``BulletClient``.
            path: a file ending in ``.zip``.
            frame_dt: s; this and the next two as ``RolloutRecorder`` says.
            substeps: look at every physics step.
            settings: roles, kinds, fingers, up, tags, fields of the header. Links are named ``BODY/LINK`` in the simulator's names and
                ``BODY_LINK`` in the trace.
            names: unique id of a body → its name, where the file's name does not tell it.

        Raises:
            RecordError: another ending, no such client, or a name that is no body's.
        """
        import pybullet

        self._p = pybullet
        self._pose, self._speed = pybullet.getBasePositionAndOrientation, pybullet.getBaseVelocity
        self._joint_states, self._link_states = pybullet.getJointStates, pybullet.getLinkStates
        self._client = int(getattr(client, "_client", client))
        if not pybullet.isConnected(self._client):
            raise RecordError(f"PyBullet has no client {client!r}. Connect first.")
        about = pybullet.getPhysicsEngineParameters(physicsClientId=self._client)
        self._links = self._list_links()
        super().__init__(path, self._name_links(names or {}), frame_dt, settings)
        self._physics_dt = float(about["fixedTimeStep"])
        self._gravity = [float(about[f"gravityAcceleration{axis}"]) for axis in "XYZ"]
        self._version_of_simulator = str(pybullet.getAPIVersion())
        lost: list[str] = []
        self._without_shape = lost
        self._describe(self._told, lost)
        self._take_frame()
        self._looks = substeps
        _watch(pybullet, self._client, self)

    # ------------------------------------------------------------------ the scene

    def _list_links(self) -> list[tuple[int, int]]:
        """(body, link) of all, −1 for a base."""
        p, client = self._p, self._client
        found = []
        for i in range(p.getNumBodies(physicsClientId=client)):
            body = p.getBodyUniqueId(i, physicsClientId=client)
            joints = p.getNumJoints(body, physicsClientId=client)
            found += [(body, link) for link in range(-1, joints)]
        return found

    def _name_links(self, given: Mapping[int, str]) -> list[str]:
        p = self._p
        names: list[str] = []
        used: set[str] = set()
        base = ""
        for body, link in self._links:
            if link == -1:
                info = p.getBodyInfo(body, physicsClientId=self._client)
                base = given.get(body) or Path(info[1].decode()).stem or f"body_{body}"
                base = f"{base}_{body}" if base in used else base
                used.add(base)
                names.append(base)
            else:
                joint = p.getJointInfo(body, link, physicsClientId=self._client)
                names.append(f"{base}/{joint[12].decode()}")
        return names

    def _describe(self, told: ToldFacts, lost: list[str]) -> None:
        """Fill in bodies and joints; find what moves, and how shapes are numbered."""
        p, client, names = self._p, self._client, self.body_names
        place = {link: i for i, link in enumerate(self._links)}
        self._infos = joints = {
            i: p.getJointInfo(*self._links[i], physicsClientId=client)
            for i in range(len(self._links))
            if self._links[i][1] >= 0
        }
        self._centres: list[tuple[Any, Any]] = []
        self._bodies, self._joints = [], []
        count = 0
        self._touches = BulletTouches()
        self._driven = [
            i for i, info in joints.items() if int(info[2]) in (p.JOINT_REVOLUTE, p.JOINT_PRISMATIC)
        ]
        masses = [
            float(p.getDynamicsInfo(*link, physicsClientId=client)[0]) for link in self._links
        ]
        free = {body: masses[place[body, -1]] > 0 for body, _ in self._links}
        jointed = {self._links[i][0] for i in self._driven}
        moves: list[bool] = []
        kinds: list[str] = []
        said: list[str | None] = []  # by the user, of the link or of one that it hangs on
        sides: dict[int, str] = {}
        for i, (body, link) in enumerate(self._links):
            above = None if link < 0 else place[body, int(joints[i][16])]
            hinged = link >= 0 and int(joints[i][2]) != p.JOINT_FIXED
            moves.append(free[body] if above is None else moves[above] or hinged)
            # many joints in a row are a robot; a drawer or a door has one on what stands still
            arm = sum(self._links[j][0] == body for j in self._driven) >= 4
            kind = "object" if free[body] and body not in jointed else "fixture"
            if arm:
                gripper = names_gripper(names[i].replace(names[place[body, -1]], "", 1))
                kind = "gripper" if gripper or (above and kinds[above] == "gripper") else "robot"
            said.append(told.kinds.get(i) or (said[above] if above is not None else None))
            kinds.append(said[i] or kind)
            if kinds[i] == "gripper" and hinged:
                side = named_side(names[i], joints[i][1].decode())
                if side:
                    sides[i] = side
                elif above in sides:
                    sides[i] = sides[above]
            elif kinds[i] == "gripper" and above in sides:
                sides[i] = sides[above]
        tips = [i for i in self._driven if kinds[i] == "gripper"]
        if not sides and len(tips) == 2:
            sides, self._sides_guessed = {tips[0]: "left", tips[1]: "right"}, True
        sides = told.fingers or sides
        for i, (body, link) in enumerate(self._links):
            facts = p.getDynamicsInfo(body, link, physicsClientId=client)
            centre, turned = np.array(facts[3]), np.array(facts[4])[_XYZW]
            self._centres.append((centre, turned))
            geoms = self._geoms(body, link, centre, turned, float(facts[1]))
            if geoms is None:
                lost.append(names[i])
            if geoms:
                self._touches.first[body, link] = count
            count += len(geoms or ())
            above = None if link < 0 else place[body, int(joints[i][16])]
            self._bodies.append(
                describe_body(
                    names[i], kinds[i], moves[i], geoms or [],
                    mass=masses[i] or None, com=centre,
                    inertia=facts[2] if masses[i] else None, inertia_orientation=turned,
                    up=told.ups.get(i), finger=sides.get(i), tags=told.tags.get(i, ()),
                    parent=None if above is None else names[above],
                    excluded=[] if above is None else [names[above]],
                )
            )  # fmt: skip
        for i in self._driven:
            info = joints[i]
            limits = [float(info[8]), float(info[9])]
            self._joints.append(
                {
                    "name": info[1].decode().replace("/", "_"),
                    "kind": "prismatic" if int(info[2]) == p.JOINT_PRISMATIC else "revolute",
                    "body": names[i],
                    "limits": limits if limits[0] < limits[1] else None,
                }
            )
        self._moving = [i for i, moving in enumerate(moves) if moving]
        self._still = [i for i, moving in enumerate(moves) if not moving]
        every: dict[int, list[int]] = {body: [] for body, _ in self._links}
        for body, link in self._links:
            if link >= 0:
                every[body].append(link)
        self._joints_of: dict[int, list[int]] = {}
        for i in self._driven:
            self._joints_of.setdefault(self._links[i][0], []).append(self._links[i][1])
        self._heavy = {body for body, free_one in free.items() if free_one}
        self._asked = {self._links[i][0]: every[self._links[i][0]] for i in self._moving}
        self._tree: LinkTree | None = None
        stands = self._place(np.array([self._ask(every)]), range(len(self._links)))
        self._stands = stands.position[0, self._still], stands.orientation[0, self._still]
        self._fingers = [j for j, i in enumerate(self._driven) if i in sides]

    def _geoms(
        self, body: int, link: int, centre: Any, turned: Any, friction: float
    ) -> list[dict[str, Any]] | None:
        """Shapes of a link; None where there are some that cannot be recorded."""
        out: list[dict[str, Any]] = []
        slide = (friction, 0.0, 0.0)
        shapes = self._p.getCollisionShapeData(body, link, physicsClientId=self._client)
        for shape in shapes or ():
            # given in the frame of the centre of mass
            position = centre + turn(turned, np.array(shape[5]))
            orientation = multiply(turned, np.array(shape[6])[_XYZW])
            kind, size = _KINDS.get(int(shape[2])), [float(s) for s in shape[3]]
            at = {"position": position, "orientation": orientation, "friction": slide}
            if kind == "sphere":
                out.append(describe_geom(kind, size[:1], **at))
            elif kind == "box":
                out.append(describe_geom(kind, [s / 2 for s in size], **at))
            elif kind in ("cylinder", "capsule"):
                out.append(describe_geom(kind, [size[1], size[0] / 2], **at))
            elif kind == "plane":
                out.append(describe_geom(kind, (), **at))
            elif kind == "mesh":
                keys = [self._meshes.keep(hull) for hull in _hulls(shape[4].decode(), size)]
                out += [describe_geom("convex_mesh", mesh=key, **at) for key in keys]
            if not out:
                return None
        return out

    # ------------------------------------------------------------------ frames

    def _watch_no_more(self) -> None:
        _unwatch(self._p, self._client)

    def _take_frame(self) -> None:
        """Keep what PyBullet tells of what moves."""
        client, told = self._client, self._ask(self._asked)
        for body, links in self._joints_of.items():
            for state in self._joint_states(body, links, client):
                told += (state[0], state[1], state[3])
        self._keep_points(array("d", told).tobytes())

    def _ask(self, links: Mapping[int, Sequence[int]]) -> list[float]:
        """Position, xyzw, velocity and angular velocity of every base, and of these links of it."""
        client, told = self._client, []
        for body, some in links.items():
            position, turned = self._pose(body, client)
            told += position
            told += turned
            if body in self._heavy:
                linear, angular = self._speed(body, client)
                told += linear
                told += angular
            else:
                told += _STILL
            if some:
                for state in self._link_states(body, some, 1, 1, client):
                    told += state[4]
                    told += state[5]
                    told += state[6]
                    told += state[7]
        return told

    def _points(self, known: Container[Any] = ()) -> list[Row]:  # noqa: ARG002 - all are asked for at once
        return self._touches.rows(self._p.getContactPoints(physicsClientId=self._client))

    def _pack_point(self, point: Any) -> bytes:
        return self._touches.pack(point)

    def _read_points(self, block: bytes) -> Any:
        return read_touches(block)

    def _columns(self, frames: list[Any]) -> dict[str, Any]:
        every = np.frombuffer(b"".join(frames)).reshape(len(frames), -1)
        every = np.ascontiguousarray(every.T).T  # time runs fastest, here and below
        asked = [
            i
            for i, (body, link) in enumerate(self._links)
            if body in self._asked and (link < 0 or link in self._asked[body])
        ]
        width = 13 * len(asked)
        told = self._place(every[:, :width], asked)
        joints = every[:, width:].reshape(len(frames), -1, 3)
        motion = Motion(
            *(
                np.zeros((len(self._links), some.shape[-1], len(frames))).transpose(2, 0, 1)
                for some in told
            )
        )
        for all_links, some in zip(motion, told):
            all_links[:, asked] = some
        if self._tree is None:
            self._plant(motion, joints)
        else:
            self._tree.place(motion, joints[..., 0], joints[..., 1])
        return {
            "position": motion.position[:, self._moving],
            "orientation": motion.orientation[:, self._moving],
            "linear_velocity": motion.linear[:, self._moving],
            "angular_velocity": motion.angular[:, self._moving],
            "joint_position": joints[..., 0],
            "joint_velocity": joints[..., 1],
            "joint_torque": joints[..., 2],
            "gripper": self._opening(joints[..., 0]),
        }

    def _place(self, told: Any, links: Sequence[int]) -> Motion:
        """Motion of the frames of links, of (T, L × 13) what ``_ask`` tells of them."""
        poses = told.reshape(len(told), -1, 13)
        position, quats = poses[..., :3].copy(), poses[..., 3:7][..., _XYZW]
        linear, angular = poses[..., 7:10].copy(), poses[..., 10:]
        for k, i in enumerate(links):
            centre, turned = self._centres[i]
            if self._links[i][1] < 0:  # a base is placed by its centre of mass, a link by its frame
                away = turned * np.array([1, -1, -1, -1])
                quats[:, k] = multiply(quats[:, k], away)
                position[:, k] -= turn(quats[:, k], centre)
            arm = turn(quats[:, k], centre)
            linear[:, k] -= cross(angular[:, k], arm)
        return Motion(position, quats, linear, angular)

    def _plant(self, motion: Motion, joints: Any) -> None:
        """Ask no longer for links that follow from their joints, which takes a fifth of the time."""
        place = {link: i for i, link in enumerate(self._links)}
        start = motion.position[0], motion.orientation[0], joints[0, :, 0]
        hinges: dict[int, Hinge] = {}
        for body, links in self._asked.items():
            own = [place[body, link] for link in links]
            found = [self._hinge(i, place, motion, joints[0, :, 0]) for i in own]
            some = {i: hinge for i, hinge in zip(own, found) if hinge is not None}
            if not own or len(some) < len(own):
                continue
            again = Motion(*(values.copy() for values in motion))
            LinkTree(some, *start).place(again, joints[..., 0], joints[..., 1])
            wrong = [np.abs(now - then).max() for now, then in zip(motion[:2], again[:2])]
            if max(wrong) < _SAME:
                hinges.update(some)
                self._asked[body] = []
        self._tree = LinkTree(hinges, *start)

    def _hinge(self, i: int, place: Mapping[Any, int], motion: Motion, joints: Any) -> Hinge | None:
        """How a link hangs by what PyBullet tells of its joint; None where that is not where it is."""
        info, body = self._infos[i], self._links[i][0]
        kind, above = int(info[2]), place[body, int(info[16])]
        slides, turns = kind == self._p.JOINT_PRISMATIC, kind == self._p.JOINT_REVOLUTE
        if not slides and not turns and kind != self._p.JOINT_FIXED:
            return None
        position, orientation = motion.position[0], motion.orientation[0]
        centre, turned = self._centres[above]
        q = joints[self._driven.index(i)] if slides or turns else 0.0
        axis = np.array(info[13]) if slides or turns else np.zeros(3)
        # PyBullet gives joints in the frames of the centres of mass
        across = multiply(orientation[above], turned)
        at = position[above] + turn(orientation[above], centre) + turn(across, np.array(info[14]))
        facing = multiply(across, np.array(info[15])[_XYZW] * np.array([1, -1, -1, -1]))
        if slides:
            at = at + turn(facing, axis * q)
        else:
            facing = multiply(facing, np.array([np.cos(q / 2), *(np.sin(q / 2) * axis)]))
        found = multiply(orientation[i], self._centres[i][1])
        if np.abs(at - position[i]).max() > _NEAR or abs(found @ facing) < 1 - _NEAR:
            return None
        joint = self._driven.index(i) if slides or turns else None
        return Hinge(above, turn(self._centres[i][1], axis), slides, joint)


def _hulls(name: str, scale: Sequence[float]) -> list[Any]:
    """(V, 3) m, points of each convex part of a mesh file."""
    path = Path(name)
    hulls = read_hulls(path) if path.is_file() else []
    return [points * np.array(scale) for points in hulls if len(points) > 3]


def _watch(pybullet: Any, client: int, recorder: PyBulletRecorder) -> None:
    """Have ``stepSimulation`` of a client tell its recorder, also through a ``BulletClient``."""
    if not _originals:
        step = pybullet.stepSimulation

        def tell(physicsClientId: int = 0) -> Any:
            result = step(physicsClientId)
            watcher = _watchers.get(physicsClientId)
            if watcher is not None:
                watcher.after_step()
            return result

        _originals["step"] = step
        pybullet.stepSimulation = tell
        try:
            from pybullet_utils.bullet_client import BulletClient
        except ImportError:
            pass
        else:  # it hands its client only to functions that are built in
            BulletClient.stepSimulation = lambda self, **_: tell(self._client)
    _watchers[client] = recorder


def _unwatch(pybullet: Any, client: int) -> None:
    _watchers.pop(client, None)
    if _originals and not _watchers:
        pybullet.stepSimulation = _originals.pop("step")
        try:
            from pybullet_utils.bullet_client import BulletClient
        except ImportError:
            pass
        else:
            del BulletClient.stepSimulation
