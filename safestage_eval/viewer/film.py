"""An episode as a small file for the browser: shapes once, poses about fifteen times a second.

The file is little-endian: the length of a JSON text (uint32), the text, zeros up to a multiple of
four, then the numbers that the text refers to by their place (bytes from there)::

    {"format": 1, "success": s or null, "frames": N, "times": place,
     "look": {"at": [x, y, z], "distance": m, "azimuth": rad, "elevation": rad},
     "bodies": [{"name", "kind", "roles": [...], "hatching", "pose": [x, y, z, w, x, y, z]}  at rest
                {"name", "kind", "roles": [...], "hatching", "track": place, "low": [...], "step": m}
                each with "geoms": [{"kind", "size", "position", "orientation", "mesh": index}]],
     "meshes": [{"vertices": place, "points": V, "low": [...], "step": m,
                 "triangles": place, "faces": F}, or {"key": name of a piece that holds such a mesh}]}

``times`` are N float32, s as in the trace. A track is (7, N) uint16, column after column, each number but the first
less the one before it (modulo 2**16): three of position, counted in steps from ``low``, four of
orientation, w x y z, 32767 being 1. Vertices are (V, 3) uint16 in steps from ``low``, triangles (F, 3)
uint32.

It holds neither verdicts nor the name of the policy.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode, Geom, Mesh, Track
from safestage_eval.geometry.hull import hull_triangles
from safestage_eval.palette import HATCHINGS

from .episode_viewpoint import look_at

RATE = 15.0
"""Poses per second."""
STEP = 5e-5
"""m, what positions are rounded to; more where the range asks for it."""
UNIT = 32767
MOST = 65535


def film(
    episode: Episode,
    rate: float = RATE,
    roles: Mapping[str, Sequence[str]] | None = None,
    shared: dict[str, bytes] | None = None,
) -> bytes:
    """Write shapes and poses of an episode in the form that ``browser/film.js`` reads.

    Args:
        episode: to be shown.
        rate: poses per second; the first and the last frame are always there.
        roles: role → bodies that are named and marked by it; the header's if None.
        shared: if given, meshes are put there by key instead, for films that have them in common.

    Raises:
        TraceError: poses of the trace are broken.
    """
    chosen = _frames(episode.t, rate)
    roles = episode.header.roles if roles is None else roles
    data = _Numbers()
    meshes: dict[str, int] = {}
    bodies = []
    for body in episode.header.bodies:
        geoms = [_geom(geom, meshes) for geom in body.geoms]
        motion = _motion(episode.tracks[body.name], chosen, data)
        bodies.append({**_names(body, roles), **motion, "geoms": geoms})
    text = {
        "format": 1,
        "success": episode.header.success_time,
        "frames": len(chosen),
        "times": data.place(episode.t[chosen].astype("<f4")),
        "look": look_at(episode)._asdict(),
        "bodies": bodies,
        "meshes": [
            _mesh(episode, key, data) if shared is None else _apart(episode, key, shared)
            for key in meshes
        ],
    }
    return packed_with(text, data.bytes)


def packed_with(head: Mapping[str, Any], numbers: bytes | bytearray) -> bytes:
    """JSON and the numbers that it refers to, as one file."""
    text = json.dumps(head, ensure_ascii=False, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    return len(text).to_bytes(4, "little") + text + bytes(numbers)


class _Numbers:
    """Arrays one after another, each at a multiple of four bytes."""

    def __init__(self) -> None:
        self.bytes = bytearray()

    def place(self, array: NDArray[Any]) -> int:
        """Append an array; return where it starts."""
        start, raw = len(self.bytes), array.tobytes()
        self.bytes += raw + bytes(-len(raw) % 4)
        return start


def _frames(t: NDArray[np.float64], rate: float) -> NDArray[np.intp]:
    """Indices of the frames nearest to an even beat, ascending, without doubles."""
    beat = np.append(np.arange(t[0], t[-1], 1 / rate), t[-1])
    after = np.searchsorted(t, beat).clip(1, max(len(t) - 1, 1))
    before = after - 1
    after = after.clip(0, len(t) - 1)
    return np.unique(np.where(beat - t[before] < t[after] - beat, before, after))


def _names(body: Body, roles: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    own = [role for role, names in roles.items() if body.name in names]
    marks = [HATCHINGS[role] for role in own if role in HATCHINGS]
    return {"name": body.name, "kind": body.kind, "roles": own, "hatching": (marks or ["plain"])[0]}


def _geom(geom: Geom, meshes: dict[str, int]) -> dict[str, Any]:
    result: dict[str, Any] = {
        "kind": geom.kind,
        "size": geom.size,
        "position": geom.position,
        "orientation": geom.orientation,
    }
    if geom.mesh is not None:
        result["mesh"] = meshes.setdefault(geom.mesh, len(meshes))
    return result


def _motion(track: Track, chosen: NDArray[np.intp], data: _Numbers) -> dict[str, Any]:
    if len(track) == 1:
        chosen = chosen[:1] * 0
    position = track.position[chosen].astype(np.float64)
    turn = _continuous(track.orientation[chosen].astype(np.float64))
    if (np.ptp(position, 0) < STEP).all() and (np.ptp(turn, 0) < 1 / UNIT).all():
        pose = [*position[0], *turn[0]]
        return {"pose": [round(float(value), 6) for value in pose]}
    low, step, counted = _counted(position)
    turned = np.round(turn * UNIT).astype(np.int64)
    columns = np.concatenate([counted, turned], 1).T
    steps = np.diff(columns, axis=1, prepend=0) & MOST
    return {"track": data.place(steps.astype("<u2")), "low": low, "step": step}


def _continuous(orientation: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, 4) unit quaternions with the signs that keep each near the one before."""
    unit = orientation / np.linalg.norm(orientation, axis=1, keepdims=True)
    flips = np.einsum("ij,ij->i", unit[1:], unit[:-1]) < 0
    sign = np.where(np.append(False, np.logical_xor.accumulate(flips)), -1.0, 1.0)
    return np.asarray(unit * sign[:, None])


def _counted(points: NDArray[np.float64]) -> tuple[list[float], float, NDArray[np.int64]]:
    """Lowest corner (m), step (m) and whole steps (N, 3), 0 … 65535, from there."""
    low = points.min(0)
    step = max(STEP, float((points.max(0) - low).max()) / MOST)
    steps = np.round((points - low) / step).astype(np.int64)
    return [float(value) for value in low], step, steps


def _apart(episode: Episode, key: str, shared: dict[str, bytes]) -> dict[str, str]:
    name = f"m{key[:24]}"
    if name not in shared:
        data = _Numbers()
        shared[name] = packed_with(_mesh(episode, key, data), data.bytes)
    return {"key": name}


def _mesh(episode: Episode, key: str, data: _Numbers) -> dict[str, Any]:
    vertices, faces = outer(episode.meshes[key])
    low, step, steps = _counted(vertices.astype(np.float64))
    return {
        "vertices": data.place(steps.astype("<u2")),
        "points": len(vertices),
        "low": low,
        "step": step,
        "triangles": data.place(faces.astype("<u4")),
        "faces": len(faces),
    }


DIRECTIONS = 240
"""Ways in which a convex mesh of many points is looked at for its outermost ones."""


def outer(mesh: Mesh) -> tuple[NDArray[np.float32], NDArray[np.integer[Any]]]:
    """Vertices (V, 3) m and outward triangles (F, 3) of a mesh's surface.

    A mesh with faces is taken as it is. A bare set of points becomes its convex hull; of more than
    ``DIRECTIONS`` points only the outermost ones are kept, so that the drawn hull lies inside the
    true one, a little smaller. Points in a plane have no hull: no triangles.
    """
    if len(mesh.faces) or len(mesh.vertices) < 4:
        return mesh.vertices, mesh.faces
    points = mesh.vertices
    if len(points) > DIRECTIONS:
        points = points[outermost(points - points.mean(0), DIRECTIONS)]
    hull = hull_triangles(points.astype(np.float64))
    if hull is None:
        return points, mesh.faces
    kept, rows = np.unique(hull.corners, return_inverse=True)
    return points[kept], rows.reshape(-1, 3)


def outermost(points: NDArray[Any], count: int) -> NDArray[np.intp]:
    """Rows of points (N, 3) that are farthest in one of ``count`` nearly even directions."""
    return np.unique((points @ _lattice(count).astype(points.dtype).T).argmax(0))


@cache
def _lattice(count: int) -> NDArray[np.float64]:
    """(count, 3) nearly even unit vectors (Gonzalez 2010, "Measurement of areas on a sphere")."""
    i = np.arange(count) + 0.5
    z = 1 - 2 * i / count
    turn = np.pi * (1 + 5**0.5) * i
    ring = np.sqrt(1 - z * z)
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), z], -1)
