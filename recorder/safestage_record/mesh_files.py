"""Vertices of OBJ and STL files, part by part, as collision shapes are made of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np


def read_hulls(path: Path) -> list[Any]:
    """(V, 3) points of each convex part of a mesh file; none where its format is not known.

    An OBJ file has a part for each object or group with faces, as decompositions are stored.
    """
    suffix = path.suffix.lower()
    if suffix == ".obj":
        return _read_obj(path)
    if suffix == ".stl":
        return [_read_stl(path.read_bytes())]
    return []


def _read_obj(path: Path) -> list[Any]:
    points: list[list[float]] = []
    parts: list[set[int]] = [set()]
    for line in path.read_text(errors="replace").splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "v":
            points.append([float(w) for w in words[1:4]])
        elif words[0] in ("o", "g") and parts[-1]:
            parts.append(set())
        elif words[0] == "f":
            numbers = (int(w.split("/")[0]) for w in words[1:])
            parts[-1].update(n - 1 if n > 0 else len(points) + n for n in numbers)
    every = np.array(points, float).reshape(-1, 3)
    return [every[sorted(part)] for part in parts if part] or [every]


def _read_stl(content: bytes) -> Any:
    count = int(np.frombuffer(content[80:84], "<u4")[0]) if len(content) >= 84 else 0
    if len(content) == 84 + 50 * count:
        kind = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("about", "<u2")])
        corners = np.frombuffer(content, kind, count, 84)["corners"].reshape(-1, 3)
    else:
        lines = (line.split() for line in content.decode(errors="replace").splitlines())
        corners = np.array([w[1:4] for w in lines if w[:1] == ["vertex"]], float).reshape(-1, 3)
    return np.unique(corners, axis=0).astype(float)
