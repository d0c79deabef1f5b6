"""The poses of poses.toml."""

from __future__ import annotations

import tomllib
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from safestage_eval.episode import Body, Geom, Mesh
from safestage_eval.geometry.group_clearance import Clearance, clearance_series
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.shape import BodyShape

HERE = Path(__file__).parent


class Pose(NamedTuple):
    """A row of poses.toml; ``truth`` is a signed distance in m, None for "penetrates"."""

    name: str
    a: Mover
    b: Mover
    truth: float | None


def poses() -> list[Pose]:
    """All of them."""
    rows = tomllib.loads((HERE / "poses.toml").read_text())["pose"]
    return [
        Pose(
            row["name"],
            _mover(row["a"]),
            _mover(row["b"]),
            None if row["truth"] == "penetrates" else float(row["truth"]),
        )
        for row in rows
    ]


def _mover(row: dict[str, Any]) -> Mover:
    kind, size = row["kind"], tuple(map(float, row.get("size", ())))
    meshes: dict[str, Mesh] = {}
    if kind in ("mesh", "hull", "octahedron"):
        corners = np.array(list(product((-1, 1), repeat=3))) if kind != "octahedron" else None
        tips = np.concatenate([np.eye(3), -np.eye(3)])
        points = (tips if corners is None else corners) * np.array(size)
        mesh = Mesh.build(points, BOX_FACES if kind == "mesh" else ())
        meshes[mesh.key] = mesh
        geom = Geom(kind="mesh" if kind == "mesh" else "convex_mesh", mesh=mesh.key)
    else:
        geom = Geom(kind=kind, size=size)
    shape = BodyShape.build(Body(name="thing", kind="object", geoms=(geom,)), meshes)
    turn = np.array(row.get("turn", (1, 0, 0, 0)), float)
    return Mover.build(shape, np.array(row.get("at", (0, 0, 0)), float), turn)


BOX_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip
"""Faces over the corners (±1, ±1, ±1) in the order of ``itertools.product``, outward."""


def asked(pose: Pose) -> list[Clearance]:
    """The clearance both ways round."""
    pairs = ((pose.a, pose.b), (pose.b, pose.a))
    return [clearance_series([a], [b], deep=True) for a, b in pairs]
