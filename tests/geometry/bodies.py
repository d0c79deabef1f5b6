"""Shapes and motions that the tests of this room are made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from safestage_eval.episode import Body, Geom, Mesh
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.pose import unit
from safestage_eval.geometry.shape import BodyShape

IDENTITY = (1.0, 0.0, 0.0, 0.0)
KINDS = ("sphere", "capsule", "box", "cylinder", "ellipsoid", "convex_mesh")


def shape(*geoms: Geom, meshes: dict[str, Mesh] | None = None, name: str = "thing") -> BodyShape:
    return BodyShape.build(Body(name=name, kind="object", geoms=geoms), meshes or {})


def box(*half: float, at: tuple[float, float, float] = (0, 0, 0)) -> Geom:
    return Geom(kind="box", size=half, position=at)


def cylinder(radius: float, half: float) -> Geom:
    return Geom(kind="cylinder", size=(radius, half))


def sphere(radius: float) -> Geom:
    return Geom(kind="sphere", size=(radius,))


def put(what: BodyShape | Geom, position: ArrayLike, orientation: ArrayLike = IDENTITY) -> Mover:
    if isinstance(what, Geom):
        what = shape(what)
    return Mover.build(what, position, orientation)


def any_geom(rng: np.random.Generator, kind: str, meshes: dict[str, Mesh]) -> Geom:
    """A geom of a few centimetres in a random pose in its body."""
    place = {
        "position": tuple(rng.uniform(-0.03, 0.03, 3)),
        "orientation": tuple(unit(rng.normal(size=4))),
    }
    if kind == "convex_mesh":
        v = rng.normal(size=(int(rng.integers(6, 50)), 3))
        v /= np.linalg.norm(v, axis=1, keepdims=True)
        mesh = Mesh.build(v * rng.uniform(0.02, 0.08, 3))
        meshes[mesh.key] = mesh
        return Geom(kind="convex_mesh", mesh=mesh.key, **place)
    count = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}[kind]
    return Geom(kind=kind, size=tuple(rng.uniform(0.01, 0.08, count)), **place)


def any_shape(rng: np.random.Generator, geoms: int = 3) -> BodyShape:
    meshes: dict[str, Mesh] = {}
    return shape(
        *(any_geom(rng, str(rng.choice(KINDS)), meshes) for _ in range(geoms)), meshes=meshes
    )


def wander(rng: np.random.Generator, frames: int, reach: float, pause: float = 0.3) -> np.ndarray:
    """(frames, 7) a pose that drifts, turns, jumps now and then and rests exactly now and then."""
    move = rng.normal(size=(frames, 3)) * 0.02 * reach
    turn = rng.normal(size=(frames, 4)) * 0.03
    rest = np.repeat(rng.random(-(-frames // 20)) < pause, 20)[:frames]
    move[rest], turn[rest] = 0, 0
    position = rng.normal(size=3) * reach * 0.5 + np.cumsum(move, 0)
    jump = int(rng.integers(frames))
    position[jump:] = position[jump:] + rng.normal(size=3) * reach * 0.3
    orientation = unit(rng.normal(size=4) + np.cumsum(turn, 0))
    return np.concatenate([position, orientation], 1).astype(np.float32)


def wanderer(rng: np.random.Generator, frames: int, reach: float, geoms: int = 3) -> Mover:
    poses = wander(rng, frames, reach)
    return Mover.build(any_shape(rng, geoms), poses[:, :3], poses[:, 3:])
