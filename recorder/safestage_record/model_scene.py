"""Bodies, shapes and joints of a compiled MuJoCo model, as a trace's header has them."""

from __future__ import annotations

from typing import Any, Mapping, Sequence

import numpy as np

from .body_facts import BodyFacts
from .scene_parts import MeshStore, describe_body, describe_geom, multiply, turn
from .scene_parts import floats as _floats

_SIZES = {"sphere": 1, "box": 3, "cylinder": 2, "capsule": 2, "ellipsoid": 3, "plane": 0}


class ModelScene:
    """The scene of a model, and where MuJoCo keeps its parts.

    Attributes:
        bodies: JSON of the header's bodies, in MuJoCo's order; the world only if it has shapes.
        joints: JSON of those of one degree of freedom.
        meshes: digest → ((V, 3) float32 m, (F, 3) int32) of what the shapes refer to.
        movable, fixed: MuJoCo ids of the bodies that move, and of those that do not.
        geom_index: (ngeom,) MuJoCo geom id → index over all geoms of ``bodies``; −1 for the rest.
        joint_qpos, joint_dof: addresses of the joints.
        without_shape: names of bodies with a shape that cannot be recorded.
        whole: MuJoCo id of a body that is a part of an object → id of the object; parts that no joint
            joins are one body, as they are one thing.
    """

    def __init__(
        self,
        model: Any,
        names: list[str],
        facts: BodyFacts,
        ups: Mapping[int, Sequence[float]],
        tags: Mapping[int, Sequence[str]],
        enums: Any,
    ) -> None:
        """Read a compiled model. ``ups``, ``tags``: body id → up axis (3,), tags."""
        self._model, self._names, self._mj = model, names, enums
        self.meshes = MeshStore()
        self.without_shape: list[str] = []
        self._keys: dict[tuple[str, int], str] = {}
        self.geom_index = np.full(model.ngeom, -1, np.int64)
        touching = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        if model.npair:
            touching[model.pair_geom1] = touching[model.pair_geom2] = True
        self._touching = touching
        weld = model.body_weldid.astype(int)
        self._parts = _rigid_parts(weld, facts.kinds)
        merged = {part for parts in self._parts.values() for part in parts}
        self.whole = {part: root for root, parts in self._parts.items() for part in parts}
        world = bool(touching[model.geom_bodyid == 0].any())
        every = range(0 if world else 1, model.nbody)
        self.ids = [i for i in every if i not in merged]
        excluded = self._excluded(weld)
        self.bodies = [
            self._body(
                i, facts, bool(weld[i] == 0), self._up(i, ups), self._tags(i, tags), excluded
            )
            for i in self.ids
        ]
        self.movable = np.array([i for i in self.ids if weld[i] != 0], np.int64)
        self.fixed = np.array([i for i in self.ids if weld[i] == 0], np.int64)
        slide = int(enums.mjtJoint.mjJNT_SLIDE)
        ones = [j for j in range(model.njnt) if int(model.jnt_type[j]) >= slide]
        self.joint_qpos = model.jnt_qposadr[ones].astype(np.int64)
        self.joint_dof = model.jnt_dofadr[ones].astype(np.int64)
        self.joints = [self._joint(j, int(model.jnt_type[j]) == slide) for j in ones]

    def _body(
        self,
        i: int,
        facts: BodyFacts,
        fixed: bool,
        up: Sequence[float] | None,
        tags: Sequence[str],
        excluded: Mapping[int, set[int]],
    ) -> dict[str, Any]:
        model, kind = self._model, facts.kinds[i]
        robot = kind in ("robot", "gripper")
        geoms = [geom for part in (i, *self._parts.get(i, ())) for geom in self._geoms(part, i)]
        parent = int(model.body_parentid[i])
        jointed = parent != 0 and (not fixed or robot)
        drawn = robot and int(model.body_geomnum[i]) > 0
        mass, com, inertia, axes = self._inertia(i)
        known = (mass or None) if geoms or drawn else 0.0
        return describe_body(
            self._names[i], kind, not fixed, geoms, mass=known, com=com, inertia=inertia, inertia_orientation=axes, up=up,
            finger=facts.sides.get(i), tags=tags,
            parent=self._names[parent] if jointed else None,
            excluded=[self._names[other] for other in excluded.get(i, ())],
        )  # fmt: skip

    def _up(self, i: int, ups: Mapping[int, Sequence[float]]) -> Any:
        """The up axis that was given of an object or of one of its parts, in the object's frame."""
        told = [part for part in (i, *self._parts.get(i, ())) if part in ups]
        return turn(self._pose_in(told[0], i)[1], np.array(ups[told[0]])) if told else None

    def _tags(self, i: int, tags: Mapping[int, Sequence[str]]) -> list[str]:
        return [word for part in (i, *self._parts.get(i, ())) for word in tags.get(part, ())]

    def _inertia(self, i: int) -> tuple[float, Any, Any, Any]:
        """Mass (kg), centre of mass (3,), principal inertia (3,) and its axes (4,) in the body frame."""
        model = self._model
        if i not in self._parts:
            return (
                float(model.body_mass[i]), model.body_ipos[i], model.body_inertia[i],
                model.body_iquat[i],
            )  # fmt: skip
        parts = [i, *self._parts[i]]
        masses = np.array([float(model.body_mass[p]) for p in parts])
        total = float(masses.sum())
        poses = [self._pose_in(p, i) for p in parts]
        centres = np.array([at + turn(q, model.body_ipos[p]) for p, (at, q) in zip(parts, poses)])
        com = masses @ centres / total if total else centres[0]
        tensor = np.zeros((3, 3))
        for p, mass, centre, (_, q) in zip(parts, masses, centres, poses):
            axes = turn(multiply(q, model.body_iquat[p])[None], np.eye(3)).T
            arm = centre - com
            tensor += (axes * model.body_inertia[p]) @ axes.T
            tensor += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        values, vectors = np.linalg.eigh(tensor)
        vectors[:, 2] *= np.sign(np.linalg.det(vectors))
        quat = np.zeros(4)
        self._mj.mju_mat2Quat(quat, vectors.ravel())
        return total, com, np.maximum(values, 0.0), quat

    def _pose_in(self, body: int, root: int) -> tuple[Any, Any]:
        """(3,) m and (4,) wxyz, of a part in the frame of the object."""
        model, at, q = self._model, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
        while body != root:
            here = model.body_quat[body]
            at, q = model.body_pos[body] + turn(here, at), multiply(here, q)
            body = int(model.body_parentid[body])
        return at, q

    def _geoms(self, body: int, root: int) -> list[dict[str, Any]]:
        model = self._model
        out: list[dict[str, Any]] = []
        used: set[str] = set()
        start = int(model.body_geomadr[body])
        place, turned = self._pose_in(body, root)
        for g in range(start, start + int(model.body_geomnum[body])):
            if not self._touching[g]:
                continue
            kind = self._mj.mjtGeom(int(model.geom_type[g])).name[len("mjGEOM_") :].lower()
            mesh = None
            if kind in ("mesh", "sdf"):
                kind, mesh = self._mesh(int(model.geom_dataid[g]), hull=kind == "mesh")
            elif kind == "hfield":
                kind, mesh = "mesh", self._terrain(int(model.geom_dataid[g]))
            elif kind not in _SIZES:
                self.without_shape.append(self._names[body])
                continue
            name = model.geom(g).name.rpartition("/")[2]
            name = "" if name in used else name
            used.add(name)
            self.geom_index[g] = int((self.geom_index >= 0).sum())
            out.append(
                describe_geom(
                    kind,
                    model.geom_size[g][: _SIZES.get(kind, 0)],
                    place + turn(turned, model.geom_pos[g]),
                    multiply(turned, model.geom_quat[g]),
                    model.geom_friction[g],
                    mesh,
                    name,
                )
            )
        return out

    def _mesh(self, mesh: int, hull: bool) -> tuple[str, str]:
        """A mesh as MuJoCo collides it: its convex hull, where the compiler computed one."""
        model, kind = self._model, "convex_mesh" if hull else "mesh"
        if (kind, mesh) not in self._keys:
            start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
            vertices = np.asarray(model.mesh_vert[start : start + count], np.float32)
            faces = np.zeros((0, 3), np.int32)
            graph = int(model.mesh_graphadr[mesh])
            if not hull:
                first, many = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
                faces = np.asarray(model.mesh_face[first : first + many], np.int32)
            elif graph >= 0:  # numvert, numface, edge addresses of each vertex, their ids, …
                many = int(model.mesh_graph[graph])
                ids = model.mesh_graph[graph + 2 + many : graph + 2 + 2 * many]
                vertices = vertices[np.sort(np.asarray(ids, int))]
            self._keys[kind, mesh] = self.meshes.keep(vertices, faces)
        return kind, self._keys[kind, mesh]

    def _terrain(self, field: int) -> str:
        """The surface of a height field, as triangles in the frame of its geom."""
        model = self._model
        rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
        x_half, y_half, top, _ = (float(s) for s in model.hfield_size[field])
        start = int(model.hfield_adr[field])
        heights = model.hfield_data[start : start + rows * columns].reshape(rows, columns)
        x, y = np.meshgrid(
            np.linspace(-x_half, x_half, columns), np.linspace(-y_half, y_half, rows)
        )
        vertices = np.stack([x, y, heights * top], axis=-1).reshape(-1, 3)
        corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        low = np.stack([corner, corner + 1, corner + columns], axis=1)
        high = np.stack([corner + 1, corner + columns + 1, corner + columns], axis=1)
        return self.meshes.keep(vertices, np.concatenate([low, high]))

    def _excluded(self, weld: Any) -> dict[int, set[int]]:
        """Bodies whose contacts with each one MuJoCo ignores: excluded by name, or next in the tree."""
        model = self._model
        parent = model.body_parentid.astype(int)
        above = weld[parent[weld]]
        moving = np.flatnonzero(weld)
        excluded: dict[int, set[int]] = {}
        for body in moving:
            near = (weld[moving] == weld[body]) | (above[moving] == weld[body])
            near |= weld[moving] == above[body]
            excluded[int(body)] = {int(other) for other in moving[near] if other != body}
        for signature in model.exclude_signature:
            first, second = int(signature) >> 16, int(signature) & 0xFFFF
            excluded.setdefault(first, set()).add(second)
            excluded.setdefault(second, set()).add(first)
        return {body: others & set(self.ids) for body, others in excluded.items()}

    def _joint(self, j: int, slide: bool) -> dict[str, Any]:
        model = self._model
        return {
            "name": model.joint(j).name.replace("/", "_") or f"joint_{j}",
            "kind": "prismatic" if slide else "revolute",
            "body": self._names[int(model.jnt_bodyid[j])],
            "limits": _floats(model.jnt_range[j]) if model.jnt_limited[j] else None,
        }


def _rigid_parts(weld: Any, kinds: Sequence[str]) -> dict[int, list[int]]:
    """Object → the bodies that are fixed to it."""
    parts: dict[int, list[int]] = {}
    for i, root in enumerate(int(w) for w in weld):
        if root not in (0, i) and kinds[i] == kinds[root] == "object":
            parts.setdefault(root, []).append(i)
    return parts
