"""What a compiled world consists of, as a trace's header says it: bodies, shapes, joints."""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from safestage_eval.episode import Body, Geom, Joint, Mesh, Tcp

from . import arm
from .world import World

_KINDS = {
    mujoco.mjtGeom.mjGEOM_SPHERE: ("sphere", 1),
    mujoco.mjtGeom.mjGEOM_BOX: ("box", 3),
    mujoco.mjtGeom.mjGEOM_CYLINDER: ("cylinder", 2),
    mujoco.mjtGeom.mjGEOM_CAPSULE: ("capsule", 2),
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: ("ellipsoid", 3),
    mujoco.mjtGeom.mjGEOM_PLANE: ("plane", 0),
    mujoco.mjtGeom.mjGEOM_MESH: ("convex_mesh", 0),
}


class Description:
    """Bodies, meshes and joints of a world, and where MuJoCo keeps them.

    Attributes:
        bodies: all of them but MuJoCo's empty world body, in MuJoCo's order.
        joints: the robot's, in MuJoCo's order.
        meshes: convex hulls of the robot's collision meshes.
        movable: (M,) MuJoCo ids of the bodies that move.
        fixed: MuJoCo ids of those that do not.
        geom_index: (ngeom,) MuJoCo geom id → index over all geoms of ``bodies``; −1 for visuals.
    """

    def __init__(self, world: World) -> None:
        """Read a compiled world."""
        model = world.model
        self.meshes: list[Mesh] = []
        self.geom_index = np.full(model.ngeom, -1, np.int64)
        ids = range(1, model.nbody)
        self.bodies = tuple(self._body(world, i) for i in ids)
        self.movable = np.array([i for i in ids if model.body_weldid[i] != 0])
        self.fixed = [i for i in ids if model.body_weldid[i] == 0]
        slide = int(mujoco.mjtJoint.mjJNT_SLIDE)
        hinges = [j for j in range(model.njnt) if int(model.jnt_type[j]) >= slide]
        self.joint_qpos = np.array([model.jnt_qposadr[j] for j in hinges])
        self.joint_dof = np.array([model.jnt_dofadr[j] for j in hinges])
        self.joints = tuple(_joint(model, j) for j in hinges)

    def _body(self, world: World, i: int) -> Body:
        model = world.model
        raw, name = model.body(i).name, body_name(model.body(i).name)
        robot = raw.startswith(arm.PREFIX)
        known = world.objects.get(raw)
        fixed = bool(model.body_weldid[i] == 0)
        kind = "fixture" if fixed else "object"
        region = known is not None and known.region
        if region:
            kind = "region"
        if robot:
            kind = "gripper" if _is_gripper(model, i) else "robot"
        side = raw.removeprefix(arm.PREFIX).partition("_")[0]
        parent, geoms = int(model.body_parentid[i]), self._geoms(model, i, region)
        return Body.model_validate(
            {
                "name": name,
                "kind": kind,
                "movable": not fixed,
                "mass": float(model.body_mass[i]) or (None if geoms else 0.0),
                "com": _floats(model.body_ipos[i]),
                "inertia": _floats(model.body_inertia[i]),
                "inertia_orientation": _floats(model.body_iquat[i]),
                "up_axis": (0.0, 0.0, 1.0)
                if known is not None and known.up and not region
                else None,
                "finger": side if robot and side in ("left", "right") else None,
                "tcp": self._tcp(world, i),
                "material": known.material if known is not None else None,
                "tags": known.tags if known is not None else (),
                "parent": body_name(model.body(parent).name) if robot and parent else None,
                "excluded": _excluded(model, i),
                "geoms": geoms,
                "cavity": known.cavity if known is not None else None,
            }
        )

    def _geoms(self, model: mujoco.MjModel, body: int, region: bool) -> tuple[Geom, ...]:
        out = []
        start = int(model.body_geomadr[body])
        for g in range(start, start + int(model.body_geomnum[body])):
            if not (region or model.geom_contype[g] or model.geom_conaffinity[g]):
                continue
            kind, sizes = _KINDS[mujoco.mjtGeom(int(model.geom_type[g]))]
            mesh = self._hull(model, int(model.geom_dataid[g])) if kind == "convex_mesh" else None
            self.geom_index[g] = int((self.geom_index >= 0).sum())
            out.append(
                Geom.model_validate(
                    {
                        "name": model.geom(g).name.rpartition("/")[2],
                        "kind": kind,
                        "size": _floats(model.geom_size[g][:sizes]),
                        "position": _floats(model.geom_pos[g]),
                        "orientation": _floats(model.geom_quat[g]),
                        "friction": _floats(model.geom_friction[g]),
                        "mesh": mesh,
                    }
                )
            )
        return tuple(out)

    def _hull(self, model: mujoco.MjModel, mesh: int) -> str:
        start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        hull = _convex_hull(model.mesh_vert[start : start + count].tobytes())
        if all(hull.key != other.key for other in self.meshes):
            self.meshes.append(hull)
        return hull.key

    @staticmethod
    def _tcp(world: World, body: int) -> Tcp | None:
        model = world.model
        if int(model.site_bodyid[world.tcp]) != body:
            return None
        return Tcp.model_validate(
            {
                "position": _floats(model.site_pos[world.tcp]),
                "orientation": _floats(model.site_quat[world.tcp]),
            }
        )


@lru_cache(maxsize=256)
def _convex_hull(points: bytes) -> Mesh:
    """Of (V, 3) float32 m; the arm is the same in every scene."""
    vertices = np.frombuffer(points, np.float32).reshape(-1, 3)
    return Mesh.build(vertices[ConvexHull(vertices).vertices])


def body_name(raw: str) -> str:
    """A body's name in traces: ``robot/link5`` → ``robot_link5``."""
    return raw.replace("/", "_")


def _is_gripper(model: mujoco.MjModel, body: int) -> bool:
    root = model.body(f"{arm.PREFIX}{arm.GRIPPER_ROOT}").id
    while body:
        if body == root:
            return True
        body = int(model.body_parentid[body])
    return False


def _excluded(model: mujoco.MjModel, body: int) -> tuple[str, ...]:
    """Bodies whose contacts with this one MuJoCo ignores: excluded by name, or next in the tree.

    A parent and its child never collide, nor do bodies that are welded together.
    """
    weld, parent = model.body_weldid, model.body_parentid
    out = []
    for other in range(1, model.nbody):
        first, second = int(weld[body]), int(weld[other])
        above = int(weld[parent[first]]), int(weld[parent[second]])
        adjacent = first == second or (
            0 not in (first, second) and (first in above or second in above)
        )
        if other != body and adjacent and 0 not in (first, second):
            out.append(body_name(model.body(other).name))
    for signature in model.exclude_signature:
        first, second = int(signature) >> 16, int(signature) & 0xFFFF
        if body in (first, second):
            out.append(body_name(model.body(second if body == first else first).name))
    return tuple(sorted(set(out)))


def _joint(model: mujoco.MjModel, j: int) -> Joint:
    slide = int(model.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
    return Joint.model_validate(
        {
            "name": body_name(model.joint(j).name),
            "kind": "prismatic" if slide else "revolute",
            "body": body_name(model.body(int(model.jnt_bodyid[j])).name),
            "limits": _floats(model.jnt_range[j]) if model.jnt_limited[j] else None,
        }
    )


def _floats(values: NDArray[np.floating]) -> tuple[float, ...]:
    return tuple(float(v) for v in values)
