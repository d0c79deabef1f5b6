"""Arrays of untrusted NumPy archives; their unpacked size is checked first.

Objects, which would be unpickled, are refused: NumPy refuses them by default.
"""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError
from safestage_eval.size_limits import current


def npz_names(path: Path) -> frozenset[str]:
    """Return the names of the arrays in an ``.npz`` archive; none of another file, or a damaged one."""
    try:
        with path.open("rb") as stream, np.load(stream) as archive:
            return frozenset(archive.files)
    except Exception:  # noqa: BLE001 — zipfile and numpy fail in many ways on damaged bytes
        return frozenset()


def npz_arrays(path: Path, names: Collection[str]) -> dict[str, NDArray[Any]]:
    """Read those arrays of an ``.npz`` archive that it has, of some names.

    Raises:
        InputError: it is damaged, is no archive, or would become more bytes than the limit allows.
    """
    try:
        with path.open("rb") as stream, np.load(stream) as archive:
            stored = archive.zip.infolist()
            sizes = [m.file_size for m in stored if m.filename.removesuffix(".npy") in names]
            current().demand_decoded(sum(sizes), path.stat().st_size, str(path))
            arrays = {name: archive[name] for name in names if name in archive.files}
        for name, array in arrays.items():
            if not isinstance(array, np.ndarray):  # numpy returns the bytes of what is no array
                raise TypeError(f"{name!r} is no array")
        return arrays
    except InputError:
        raise
    except Exception as error:  # noqa: BLE001 — as above
        raise InputError(str(path), f"cannot be read: {error or type(error).__name__}") from None


def npy_array(path: Path) -> NDArray[Any]:
    """Read an ``.npy`` file. Raises InputError where it is damaged, or claims more than it holds."""
    try:
        return np.array(np.lib.format.open_memmap(path, mode="r"))  # as long as it says, or refused
    except Exception as error:  # noqa: BLE001 — as above
        raise InputError(str(path), f"cannot be read: {error or type(error).__name__}") from None
