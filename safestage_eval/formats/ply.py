"""Meshes as binary PLY: the asset files of a dataset and the attachments of an MCAP."""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Mesh
from safestage_eval.errors import TraceError
from safestage_eval.size_limits import current

_FACE = np.dtype([("count", "u1"), ("vertex", "<i4", 3)])
_HEADER = """ply
format binary_little_endian 1.0
element vertex {vertices}
property float x
property float y
property float z
element face {faces}
property list uchar int vertex_indices
end_header
"""


def to_ply(mesh: Mesh) -> bytes:
    """Return binary little-endian PLY: float32 vertices in m, triangles of int32 indices."""
    faces = np.empty(len(mesh.faces), _FACE)
    faces["count"], faces["vertex"] = 3, mesh.faces
    header = _HEADER.format(vertices=len(mesh.vertices), faces=len(faces))
    return header.encode() + mesh.vertices.astype("<f4").tobytes() + faces.tobytes()


def from_ply(data: bytes, key: str, where: str) -> Mesh:
    """Restore the mesh that ``to_ply`` wrote.

    Raises:
        TraceError: another PLY layout, missing bytes, or a content that is not ``key``.
    """
    counts = re.findall(rb"element \w+ (\d+)", data[:512])
    vertices, faces = (int(n) for n in counts) if len(counts) == 2 else (0, 0)
    current().demand("vertices", vertices, where)
    header = _HEADER.format(vertices=vertices, faces=faces).encode()
    if not data.startswith(header):
        raise TraceError(
            where,
            "not a mesh of this format.",
            "binary little-endian PLY with float x, y, z and triangles of int indices",
        )
    end = len(header) + 12 * vertices
    if len(data) != end + _FACE.itemsize * faces:
        raise TraceError(where, f"the mesh is cut off at byte {len(data)}")
    records = np.frombuffer(data, _FACE, faces, end)
    mesh = Mesh(
        np.frombuffer(data, "<f4", 3 * vertices, len(header)).reshape(-1, 3),
        np.ascontiguousarray(records["vertex"]),
    )
    if mesh.key != key:
        raise TraceError(
            where,
            f"the mesh has changed: its content is {mesh.key[:12]}…, expected {key[:12]}…",
            fix="restore the file or record again",
        )
    _check(mesh, records["count"], where)
    return mesh


def _check(mesh: Mesh, corners: NDArray[np.uint8], where: str) -> None:
    """Raises TraceError for vertices that are not finite, and faces of vertices that are not there."""
    if not np.isfinite(mesh.vertices).all():
        raise TraceError(where, "a vertex of the mesh is not finite")
    if (corners != 3).any():
        raise TraceError(where, "a face of the mesh is no triangle")
    try:
        Mesh.build(mesh.vertices, mesh.faces)
    except ValueError as error:
        raise TraceError(where, f"{error}.") from None
