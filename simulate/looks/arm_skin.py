"""The meshes of the arm's model that are only seen, to be hung on bodies of other models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import mujoco

from simulate.arm import droid

from .room import SCENERY_GROUP


@dataclass(frozen=True)
class ArmMesh:
    """A mesh of a link: its file, scale, place (m) and turn (wxyz) in the link's frame, its paint."""

    file: str
    scale: tuple[float, ...]
    position: tuple[float, ...]
    orientation: tuple[float, ...]
    rgba: tuple[float, ...]


@cache
def arm_meshes() -> Mapping[str, tuple[ArmMesh, ...]]:
    """Link, as the arm's MJCF names it → its meshes. Raises InputError without the arm's model."""
    path = droid.default_mjcf()
    spec = droid.arm_spec(path, visuals=True)
    out = {}
    for body in spec.bodies:
        seen = [
            geom for geom in body.geoms
            if geom.contype == 0 and geom.conaffinity == 0
            and geom.type == mujoco.mjtGeom.mjGEOM_MESH
        ]  # fmt: skip
        out[body.name] = tuple(_mesh(spec, path.parent, geom) for geom in seen)
    return {name: meshes for name, meshes in out.items() if meshes}


def _mesh(spec: mujoco.MjSpec, folder: Path, geom: Any) -> ArmMesh:
    mesh = spec.mesh(geom.meshname)
    material = spec.material(geom.material) if geom.material else None
    rgba = geom.rgba if material is None else material.rgba
    return ArmMesh(
        str(folder / spec.meshdir / mesh.file),
        tuple(map(float, mesh.scale)),
        tuple(map(float, geom.pos)),
        tuple(map(float, geom.quat)),
        tuple(map(float, rgba)),
    )


def dress_link(spec: mujoco.MjSpec, body: Any, name: str, group: int = SCENERY_GROUP) -> bool:
    """Hang a link's meshes on a body of a model to be drawn; whether there are any.

    ``name`` is the link's in the arm's MJCF.
    """
    meshes = arm_meshes().get(name, ())
    for i, mesh in enumerate(meshes):
        key = f"{name}/mesh{i}"
        spec.add_mesh(
            name=key, file=mesh.file, scale=mesh.scale,
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )  # fmt: skip
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, meshname=key, pos=mesh.position,
            quat=mesh.orientation, rgba=mesh.rgba, contype=0, conaffinity=0, mass=0, group=group,
        )  # fmt: skip
    return bool(meshes)
