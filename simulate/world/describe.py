"""Bodies, shapes and joints of a compiled model, for a trace's header."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from safestage_eval.episode import Body, Cavity, Geom, Joint, Mesh, Tcp, Vec3
from safestage_eval.errors import InputError

_KINDS = {
    mujoco.mjtGeom.mjGEOM_SPHERE: ("sphere", 1),
    mujoco.mjtGeom.mjGEOM_BOX: ("box", 3),
    mujoco.mjtGeom.mjGEOM_CYLINDER: ("cylinder", 2),
    mujoco.mjtGeom.mjGEOM_CAPSULE: ("capsule", 2),
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: ("ellipsoid", 3),
    mujoco.mjtGeom.mjGEOM_PLANE: ("plane", 0),
    mujoco.mjtGeom.mjGEOM_MESH: ("convex_mesh", 0),
}


Kind = Literal["robot", "gripper", "object", "fixture", "region"]


@dataclass(frozen=True)
class Facts:
    """Facts about a body that a model lacks; the fields are those of ``episode.Body``."""

    kind: Kind
    up_axis: Vec3 | None = None
    finger: Literal["left", "right"] | None = None
    tcp: Tcp | None = None
    material: str | None = None
    tags: tuple[str, ...] = ()
    cavity: Cavity | None = None


class Description:
    """Bodies, meshes and joints of a model, and where MuJoCo keeps them.

    Attributes:
        bodies: all of them in MuJoCo's order; its world body only if it has shapes.
        joints: of one degree of freedom, in MuJoCo's order.
        meshes: convex hulls of the collision meshes.
        movable: (M,) MuJoCo ids of the bodies that move.
        fixed: MuJoCo ids of those that do not.
        geom_index: (ngeom,) MuJoCo geom id → index over all geoms of ``bodies``; −1 for visuals.
    """

    def __init__(self, model: mujoco.MjModel, facts: Sequence[Facts]) -> None:
        """Read a model; ``facts`` by MuJoCo's body ids, the world's first.

        Raises InputError for a collision shape that no trace can hold.
        """
        self.meshes: list[Mesh] = []
        self.geom_index = np.full(model.ngeom, -1, np.int64)
        self._first = 0 if _collides(model, 0) else 1
        ids = range(self._first, model.nbody)
        self._excluded = _excluded(model)
        self.bodies = tuple(self._body(model, i, facts[i]) for i in ids)
        self.movable = np.array([i for i in ids if model.body_weldid[i] != 0], np.int64)
        self.fixed = [i for i in ids if model.body_weldid[i] == 0]
        slide = int(mujoco.mjtJoint.mjJNT_SLIDE)
        hinges = [j for j in range(model.njnt) if int(model.jnt_type[j]) >= slide]
        self.joint_qpos = np.array([model.jnt_qposadr[j] for j in hinges], np.int64)
        self.joint_dof = np.array([model.jnt_dofadr[j] for j in hinges], np.int64)
        self.joints = tuple(_joint(model, j) for j in hinges)

    def body(self, i: int) -> Body:
        """The body with MuJoCo's id."""
        return self.bodies[i - self._first]

    def _body(self, model: mujoco.MjModel, i: int, facts: Facts) -> Body:
        fixed = bool(model.body_weldid[i] == 0)
        parent = int(model.body_parentid[i])
        jointed = parent != 0 and (not fixed or facts.kind in ("robot", "gripper"))
        geoms = self._geoms(model, i, facts.kind == "region")
        return Body.model_validate(
            {
                "name": body_name(model.body(i).name),
                "kind": facts.kind,
                "movable": not fixed,
                "mass": float(model.body_mass[i]) or (None if geoms else 0.0),
                "com": _floats(model.body_ipos[i]),
                "inertia": _floats(model.body_inertia[i]),
                "inertia_orientation": _floats(model.body_iquat[i]),
                "up_axis": facts.up_axis,
                "finger": facts.finger,
                "tcp": facts.tcp,
                "material": facts.material,
                "tags": facts.tags,
                "parent": body_name(model.body(parent).name) if jointed else None,
                "excluded": self._excluded.get(i, ()),
                "geoms": geoms,
                "cavity": facts.cavity,
            }
        )

    def _geoms(self, model: mujoco.MjModel, body: int, region: bool) -> tuple[Geom, ...]:
        out = []
        start = int(model.body_geomadr[body])
        for g in range(start, start + int(model.body_geomnum[body])):
            if not (region or model.geom_contype[g] or model.geom_conaffinity[g]):
                continue
            kind, sizes = _shape(model, g)
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


@lru_cache(maxsize=256)
def _convex_hull(points: bytes) -> Mesh:
    """Digest of (V, 3) float32 m; cached, as the arm is the same in every scene."""
    vertices = np.frombuffer(points, np.float32).reshape(-1, 3)
    return Mesh.build(vertices[ConvexHull(vertices).vertices])


def body_name(raw: str) -> str:
    """A body's name in traces: ``robot/link5`` → ``robot_link5``."""
    return raw.replace("/", "_")


def _collides(model: mujoco.MjModel, body: int) -> bool:
    start, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
    own = range(start, start + count)
    return any(model.geom_contype[g] or model.geom_conaffinity[g] for g in own)


def _shape(model: mujoco.MjModel, geom: int) -> tuple[str, int]:
    """Kind of a geom, and how many sizes it has."""
    kind = mujoco.mjtGeom(int(model.geom_type[geom]))
    if kind not in _KINDS:
        raise InputError(
            f"geom {model.geom(geom).name or geom!r} of body "
            f"{model.body(int(model.geom_bodyid[geom])).name!r}",
            f"is a {kind.name.removeprefix('mjGEOM_').lower()}, which no trace can hold.",
            ", ".join(name for name, _ in _KINDS.values()),
        )
    return _KINDS[kind]


def _excluded(model: mujoco.MjModel) -> dict[int, tuple[str, ...]]:
    """Bodies whose contacts with each one MuJoCo ignores: excluded by name, or next in the tree.

    A parent and its child never collide, nor do bodies that are welded together. What is welded to
    the world is left out: none of it moves.
    """
    weld, parent = model.body_weldid.astype(int), model.body_parentid.astype(int)
    above = weld[parent[weld]]
    excluded: dict[int, set[int]] = {}
    moving = np.flatnonzero(weld)
    for body in moving:
        near = (weld[moving] == weld[body]) | (above[moving] == weld[body])
        near |= weld[moving] == above[body]
        excluded[int(body)] = {int(other) for other in moving[near] if other != body}
    for signature in model.exclude_signature:
        first, second = int(signature) >> 16, int(signature) & 0xFFFF
        excluded.setdefault(first, set()).add(second)
        excluded.setdefault(second, set()).add(first)
    return {
        body: tuple(sorted(body_name(model.body(other).name) for other in others))
        for body, others in excluded.items()
    }


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
