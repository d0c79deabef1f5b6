"""The poses of poses.toml, and what each clearance backend says of them.

    python tests/geometry/conformance/poses.py docs/clearance.md

writes the table of what python-fcl and coal get wrong anew.
"""

from __future__ import annotations

import sys
import tomllib
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from safestage_eval.episode import Body, Geom, Mesh
from safestage_eval.geometry.group_clearance import Clearance, clearance_series
from safestage_eval.geometry.mover import Mover
from safestage_eval.geometry.shape import BodyShape

HERE = Path(__file__).parent
START, END = "<!-- conformance: start -->", "<!-- conformance: end -->"
WRONG = 1e-4
"""m: what other libraries say may differ by so much from the truth before it counts as wrong."""

PACKAGES = {"fcl": "python-fcl", "coal": "coal"}


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


def asked(pose: Pose, backend: str = "gjk") -> list[Clearance]:
    """The clearance both ways round."""
    pairs = ((pose.a, pose.b), (pose.b, pose.a))
    return [clearance_series([a], [b], deep=True, backend=backend) for a, b in pairs]


def mistakes(backend: str) -> list[tuple[str, str, str]]:
    """(pose, truth, answers) wherever a library is wrong: by over 0.1 mm, or about touching.

    Saying only that there is a penetration is no mistake.
    """
    found = []
    for pose in poses():
        answers = [(float(x.lower[0]), float(x.upper[0])) for x in asked(pose, backend)]
        if any(_is_wrong(pose.truth, *answer) for answer in answers):
            values = dict.fromkeys(
                "penetrates" if np.isinf(lower) else f"{lower:.4g}" for lower, _ in answers
            )
            truth = "penetrates" if pose.truth is None else f"{pose.truth:.4g}"
            found.append((pose.name, truth, " / ".join(values)))
    return found


def _is_wrong(truth: float | None, lower: float, upper: float) -> bool:
    if truth is None:
        return upper > 0
    return lower - WRONG > truth or upper + WRONG < truth


def table() -> str:
    """Markdown: one row per pose that a library gets wrong."""
    found = {name: {row[0]: row for row in mistakes(name)} for name in PACKAGES}
    heads = " | ".join(f"{PACKAGES[name]} {version(PACKAGES[name])}" for name in PACKAGES)
    lines = [f"| pose | truth, m | {heads} |", "|---|---|---|---|"]
    for pose in poses():
        rows = [found[name].get(pose.name) for name in PACKAGES]
        if any(rows):
            truth = next(row[1] for row in rows if row)
            says = " | ".join(row[2] if row else "" for row in rows)
            lines.append(f"| {pose.name} | {truth} | {says} |")
    total = len(poses())
    counts = " and ".join(f"{PACKAGES[name]} {len(rows)}" for name, rows in found.items())
    lines += ["", f"Of {total} poses {counts} are wrong; ours, none."]
    return "\n".join(lines)


def main(path: str) -> None:
    """Write the table into a page, between its marks."""
    page = Path(path)
    text = page.read_text()
    head, tail = text.split(START)[0], text.split(END)[1]
    page.write_text(f"{head}{START}\n\n{table()}\n\n{END}{tail}")


if __name__ == "__main__":
    main(sys.argv[1])
