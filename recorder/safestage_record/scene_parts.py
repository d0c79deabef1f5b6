"""Bodies and shapes as a trace's header has them, and meshes under the digests of their content."""

from __future__ import annotations

import hashlib
from typing import Any, Dict, Mapping, Sequence, Tuple

import numpy as np

NO_TURN = (1.0, 0.0, 0.0, 0.0)


class MeshStore(Dict[str, Tuple[Any, Any]]):
    """Digest → ((V, 3) float32 m, (F, 3) int32)."""

    def keep(self, vertices: Any, faces: Any = ()) -> str:
        """Keep a mesh, and return the digest by which a trace refers to it."""
        v = np.ascontiguousarray(vertices, "<f4").reshape(-1, 3)
        f = np.ascontiguousarray(faces, "<i4").reshape(-1, 3)
        digest = hashlib.sha256(np.array(v.shape + f.shape, "<i8").tobytes())
        digest.update(v.tobytes())
        digest.update(f.tobytes())
        self[digest.hexdigest()] = (v, f)
        return digest.hexdigest()


def describe_geom(
    kind: str,
    size: Any = (),
    position: Any = (0.0, 0.0, 0.0),
    orientation: Any = NO_TURN,
    friction: Any | None = None,
    mesh: str | None = None,
    name: str = "",
) -> dict[str, Any]:
    """A shape of a body.

    Args:
        kind: sphere, box, cylinder, capsule, ellipsoid, plane, convex_mesh or mesh.
        size: m, half extents and radii; cylinders and capsules along z: radius, half length.
        position: (3,) m, in the body frame.
        orientation: (4,) wxyz, shape to body frame.
        friction: sliding, torsional, rolling; None where not known.
        mesh: digest of what ``MeshStore`` keeps.
        name: of the shape.
    """
    return {
        "name": name,
        "kind": kind,
        "size": floats(size),
        "position": floats(position),
        "orientation": floats(orientation),
        "friction": None if friction is None else floats(friction),
        "mesh": mesh,
    }


def describe_body(
    name: str,
    kind: str,
    movable: bool,
    geoms: Sequence[Mapping[str, Any]],
    *,
    mass: float | None,
    com: Any = (0.0, 0.0, 0.0),
    inertia: Any | None = None,
    inertia_orientation: Any = NO_TURN,
    up: Any | None = None,
    finger: str | None = None,
    tags: Sequence[str] = (),
    parent: str | None = None,
    excluded: Sequence[str] = (),
) -> dict[str, Any]:
    """A body: mass in kg, centre of mass (3,) in m and principal inertia (3,) in kg m² in its frame."""
    untold = [] if kind in ("robot", "gripper") or not geoms else ["cavity"]
    if kind == "object" and geoms and up is None:
        untold.insert(0, "up_axis")
    body: dict[str, Any] = {
        "name": name,
        "kind": kind,
        "movable": movable,
        "mass": mass,
        "com": floats(com),
        "inertia": None if inertia is None else floats(inertia),
        "inertia_orientation": floats(inertia_orientation),
        "up_axis": None if up is None else floats(up),
        "finger": finger,
        "tags": list(tags),
        "parent": parent,
        "excluded": sorted(excluded),
        "geoms": list(geoms),
        "untold": untold,
    }
    return body


def floats(values: Any) -> list[float]:
    """Plain numbers, for JSON."""
    return [float(v) for v in values]


def cross(first: Any, second: Any) -> Any:
    """(…, 3) cross product; several times as fast as NumPy's for many short rows."""
    a, b, c = first[..., 0], first[..., 1], first[..., 2]
    x, y, z = second[..., 0], second[..., 1], second[..., 2]
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=-1)


def turn(quats: Any, vectors: Any) -> Any:
    """(…, 3) vectors turned by (…, 4) wxyz quaternions."""
    axis = quats[..., 1:]
    twice = 2.0 * cross(axis, vectors)
    return vectors + quats[..., :1] * twice + cross(axis, twice)


def multiply(first: Any, second: Any) -> Any:
    """(…, 4) wxyz, the turn by ``second`` and then by ``first``."""
    a, b, c, d = (first[..., k] for k in range(4))
    w, x, y, z = (second[..., k] for k in range(4))
    return np.stack(
        [
            a * w - b * x - c * y - d * z,
            a * x + b * w + c * z - d * y,
            a * y - b * z + c * w + d * x,
            a * z + b * y - c * x + d * w,
        ],
        axis=-1,
    )
