"""Mesh files that robot descriptions and map files name."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError

SHAPES = (".obj", ".stl", ".ply", ".off", ".glb", ".gltf", ".dae")


def read_mesh(path: Path) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Read a mesh: (V, 3) vertices in the file's own unit, and (F, 3) faces.

    Of other files that it names, only those that end in .bin are read, and only beside it.

    Raises:
        InputError: there is no such file, it has another ending, or no mesh can be read from it.
    """
    kind = path.suffix.lower()
    if kind not in SHAPES or not path.is_file():
        raise InputError(str(path), "is no mesh file.", f"a file that ends in {', '.join(SHAPES)}")
    try:
        import trimesh
    except ImportError:
        raise InputError(
            str(path), "is a mesh file, which trimesh reads.", fix="pip install 'safestage[import]'"
        ) from None
    # of a path or an open file, trimesh would open whatever it names
    data, beside = BytesIO(path.read_bytes()), _Beside(path.parent)
    try:
        loaded: Any = trimesh.load(data, file_type=kind[1:], resolver=beside, force="mesh")
        vertices = np.asarray(loaded.vertices, np.float64)
        faces = np.asarray(loaded.faces, np.int64)
    except Exception as error:  # noqa: BLE001 — its loaders raise anything
        said = str(error) or type(error).__name__
        raise InputError(str(path), f"no mesh could be read: {said}.") from None
    if not len(faces):
        raise InputError(str(path), "no mesh could be read: it has no triangles.")
    return vertices, faces


class _Beside:
    """Resolver for trimesh that opens only glTF buffers beside the mesh."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def get(self, name: str) -> bytes:
        """Read a file. Raises FileNotFoundError for what is no buffer beside the mesh."""
        path = self._folder / name
        if Path(name).name != name or path.suffix != ".bin" or not path.is_file():
            raise FileNotFoundError(f"{name!r} is no .bin file beside it")
        return path.read_bytes()

    __getitem__ = get
