"""Records one rollout of a PyBullet simulation, whoever steps it."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import Any, Callable, Mapping, Sequence

import numpy as np

from .mesh_files import read_hulls
from .point_log import NO_SHAPE
from .point_recorder import PointRecorder
from .record_error import RecordError
from .rollout_recorder import FRAME_DT
from .scene_parts import MeshStore, describe_body, describe_geom, multiply, turn
from .told_facts import Names, ToldFacts, named_side, names_gripper, tell_apart
from .zip_trace import CONTACT_POINT

_XYZW = [3, 0, 1, 2]
_KINDS = {2: "sphere", 3: "box", 4: "cylinder", 5: "mesh", 6: "plane", 7: "capsule"}
_watchers: dict[int, PyBulletRecorder] = {}
_originals: dict[str, Callable[..., Any]] = {}


class PyBulletRecorder(PointRecorder):
    """Records one rollout; as a context manager it writes the file at the end of the block.

    A frame is taken after a physics step: poses as they then are, contacts and forces of the step.
    """

    simulator = "PyBullet"
    _meshes: MeshStore

    def __init__(
        self,
        client: Any,
        path: str | Path,
        *,
        roles: Mapping[str, Names] | None = None,
        kinds: Mapping[str, str] | None = None,
        fingers: Mapping[str, str] | None = None,
        up: str | Mapping[str, Sequence[float]] | None = None,
        tags: Mapping[str, Sequence[str]] | None = None,
        names: Mapping[int, str] | None = None,
        frame_dt: float | None = FRAME_DT,
        substeps: bool = True,
        **header: Any,
    ) -> None:
        """Begin to record; nothing in the simulation is changed.

        Args:
            client: number of the physics client, or a ``BulletClient``.
            path: a file ending in ``.zip``.
            roles: role of the safety rules → name or names of bodies.
            kinds: body name → kind, where guessed wrong.
            fingers: body name → left or right, where guessed wrong.
            up: body name → axis, or "guess".
            tags: body name → words. All of these as of ``MujocoRecorder``. Links are named
                ``BODY/LINK`` in the simulator's names and ``BODY_LINK`` in the trace.
            names: unique id of a body → its name, where the file's name does not tell it.
            frame_dt: s between frames, to the next physics step; None: one frame per ``step``.
            substeps: look at every physics step, so that forces between two frames are known.
            header: further fields of the trace's header.

        Raises:
            RecordError: another ending, no such client, or a name that is no body's.
        """
        import pybullet

        self._p = pybullet
        self._client = int(getattr(client, "_client", client))
        if not pybullet.isConnected(self._client):
            raise RecordError(f"PyBullet has no client {client!r}. Connect first.")
        about = pybullet.getPhysicsEngineParameters(physicsClientId=self._client)
        self._links = self._list_links()
        self.body_names = tell_apart(self._name_links(names or {}))
        told = ToldFacts(self.body_names, roles, kinds, fingers, up, tags)
        super().__init__(path, told, frame_dt, **header)
        self._physics_dt = float(about["fixedTimeStep"])
        self._gravity = [float(about[f"gravityAcceleration{axis}"]) for axis in "XYZ"]
        self._version_of_simulator = str(pybullet.getAPIVersion())
        self._meshes = MeshStore()
        lost: list[str] = []
        self._without_shape = lost
        self._describe(told, lost)
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
        joints = {
            i: p.getJointInfo(*self._links[i], physicsClientId=client)
            for i in range(len(self._links))
            if self._links[i][1] >= 0
        }
        self._centres: list[tuple[Any, Any]] = []
        self._bodies, self._joints = [], []
        owner: list[int] = []
        # by body and link; a base, link −1, is the last, and bodies that came later are none
        most = [max(some) for some in zip(*self._links)] or [0, 0]
        self._first_geom = np.full((most[0] + 2, most[1] + 2), -1)
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
            given = told.kinds.get(i)
            if given is None and above is not None and self._told_above(above, told, place, joints):
                given = kinds[above]
            kinds.append(given or kind)
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
                self._first_geom[body, link] = len(owner)
            owner += [i] * len(geoms or ())
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
        self._links_of = {
            body: [link for other, link in self._links if other == body and link >= 0]
            for body, _ in self._links
        }
        self._joints_of: dict[int, list[int]] = {}
        for i in self._driven:
            self._joints_of.setdefault(self._links[i][0], []).append(self._links[i][1])
        self._mobile = list(dict.fromkeys(self._links[i][0] for i in self._moving))
        every = list(self._links_of)
        position, quats, _, _ = self._place([self._ask(every)], every)
        self._stands = position[0, self._still], quats[0, self._still]
        self._own(owner)
        self._fingers = [j for j, i in enumerate(self._driven) if i in sides]

    def _told_above(self, i: int, told: ToldFacts, place: Any, joints: Any) -> bool:
        """Whether the user gave a kind of this link, or of one that it hangs on."""
        while i not in told.kinds:
            body, link = self._links[i]
            if link < 0:
                return False
            i = place[body, int(joints[i][16])]
        return True

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
        client, joints = self._client, []
        for body, links in self._joints_of.items():
            states = self._p.getJointStates(body, links, physicsClientId=client)
            joints += [(state[0], state[1], state[3]) for state in states]
        self._keep_points((self._ask(self._mobile), np.array(joints, float)))

    def _ask(self, bodies: Sequence[int]) -> Any:
        """(L × 13,) position, xyzw, velocity and angular velocity of every link, the base's first."""
        p, client = self._p, self._client
        told: list[Any] = []
        for body in bodies:
            place = p.getBasePositionAndOrientation(body, physicsClientId=client)
            told += [*place, *p.getBaseVelocity(body, physicsClientId=client)]
            links = self._links_of[body]
            if links:
                states = p.getLinkStates(body, links, 1, 1, physicsClientId=client)
                told += chain.from_iterable(state[4:8] for state in states)
        return np.fromiter(chain.from_iterable(told), float)

    def _points(self) -> Any:
        return self._p.getContactPoints(physicsClientId=self._client)

    def _read_points(self, rows: Sequence[Any]) -> Any:
        points = np.zeros(len(rows), CONTACT_POINT)
        points["geom1"] = NO_SHAPE
        if not rows:
            return points
        vectors = chain.from_iterable((c[5], c[7], c[11], c[13]) for c in rows)
        position, normal, *along = (
            np.fromiter(chain.from_iterable(vectors), float).reshape(-1, 4, 3).swapaxes(0, 1)
        )
        about = chain.from_iterable(
            (c[1], c[3], c[2], c[4], c[8], c[9], c[10], c[12]) for c in rows
        )
        numbers = np.fromiter(about, float).reshape(-1, 8)
        apart, size, *aside = numbers[:, 4:].T
        # Bullet's normal points from the second body to the first
        force = -size[:, None] * normal
        for push, axis in zip(aside, along):
            force -= push[:, None] * axis
        points["position"], points["normal"] = position, -normal
        points["force"], points["peak_force"], points["depth"] = force, size, -apart
        ends = numbers[:, :4].astype(int)
        table = self._first_geom
        later = ends >= np.tile(np.array(table.shape) - 1, 2)
        ends[later.any(axis=1)] = len(table) - 1, -1, len(table) - 1, -1
        geoms = table[ends[:, 0], ends[:, 1]], table[ends[:, 2], ends[:, 3]]
        touch = (size > 0) | (apart <= 0)
        known = (geoms[0] >= 0) & (geoms[1] >= 0)
        self._unrecorded += int((touch & ~known).sum())
        there = touch & known
        points["geom1"][there], points["geom2"][there] = geoms[0][there], geoms[1][there]
        return points

    def _columns(self, frames: list[Any]) -> dict[str, Any]:
        position, quats, linear, angular = self._place([told for told, _ in frames], self._mobile)
        joints = np.array([some[1] for some in frames]).reshape(len(frames), -1, 3)
        told = [i for i, (body, _) in enumerate(self._links) if body in self._mobile]
        moving = [told.index(i) for i in self._moving]
        return {
            "position": position[:, moving],
            "orientation": quats[:, moving],
            "linear_velocity": linear[:, moving],
            "angular_velocity": angular[:, moving],
            "joint_position": joints[..., 0],
            "joint_velocity": joints[..., 1],
            "joint_torque": joints[..., 2],
            "gripper": self._opening(joints[..., 0]),
        }

    def _place(self, told: Sequence[Any], bodies: Sequence[int]) -> tuple[Any, Any, Any, Any]:
        """(T, L, 3 or 4) positions, wxyz and velocities of the frames of links, for the bodies given to ``_ask``."""
        poses = np.array(told).reshape(len(told), -1, 13)
        position, quats = poses[..., :3], poses[..., 3:7][..., _XYZW]
        linear, angular = poses[..., 7:10].copy(), poses[..., 10:]
        links = [i for i, (body, _) in enumerate(self._links) if body in bodies]
        for k, i in enumerate(links):
            centre, turned = self._centres[i]
            if self._links[i][1] < 0:  # a base is placed by its centre of mass, a link by its frame
                away = turned * np.array([1, -1, -1, -1])
                quats[:, k] = multiply(quats[:, k], np.broadcast_to(away, quats[:, k].shape))
                position[:, k] -= turn(quats[:, k], np.broadcast_to(centre, position[:, k].shape))
            arm = turn(quats[:, k], np.broadcast_to(centre, position[:, k].shape))
            linear[:, k] -= np.cross(angular[:, k], arm)
        return position, quats, linear, angular


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
            result = step(physicsClientId=physicsClientId)
            if physicsClientId in _watchers:
                _watchers[physicsClientId].after_step()
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
