"""Opening HDF5 files, which several foreign formats are."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError, TraceError
from safestage_eval.size_limits import current

from .importer import SourceError

_LOOKED_AT: set[tuple[Path, int, int]] = set()
"""Files without ways out, by path, time of change and size."""

MAGIC = b"\x89HDF\r\n\x1a\n"

DEEPEST = 32
"""Groups inside each other."""

MOST_BYTES = 1 << 33
"""Bytes that one dataset may unpack to."""


def is_hdf5(path: Path) -> bool:
    """True if a file begins with the HDF5 signature."""
    try:
        with path.open("rb") as stream:
            return stream.read(8) == MAGIC
    except OSError:
        return False


def open_hdf5(path: Path) -> Any:
    """Open a file with h5py for reading, and refuse links that lead out of it.

    A damaged file can keep the library busy for ever: strangers' files are read in a child with a time limit
    (``read_source.Apart``).

    Raises:
        SourceError: h5py is not installed, or the file is damaged.
    """
    try:
        import h5py
    except ImportError:
        raise SourceError(
            str(path), "is an HDF5 file, which h5py reads.", fix="pip install 'safestage[import]'"
        ) from None
    try:
        stat = path.stat()
        checked = (path, stat.st_mtime_ns, stat.st_size) in _LOOKED_AT
        file = h5py.File(path, "r")
        if not checked:
            _check(file, str(path), set())
            _LOOKED_AT.add((path, stat.st_mtime_ns, stat.st_size))
        return file
    except OSError as error:
        raise SourceError(
            str(path), f"cannot be read: {error}.",
            fix="download it again; a recording that was killed may leave such a file",
        ) from None  # fmt: skip
    except (RuntimeError, KeyError, ValueError) as error:
        lines = str(error).strip("'\"").splitlines() or [type(error).__name__]
        raise SourceError(
            str(path), f"a damaged HDF5 file: {lines[0]}.", fix="download it again"
        ) from None


def _check(group: Any, where: str, seen: set[Any], depth: int = 0) -> None:
    """Look at every group and dataset for what leads out of the file, or would not fit into memory.

    A dataset can have its numbers in any other file of this machine (external storage, virtual datasets), a link can
    lead into another file, and groups can be linked twice: round in a circle, or by so many ways that nobody comes to
    an end.

    Raises:
        SourceError: one does.
    """
    import h5py

    if depth > DEEPEST:
        raise _refused(where, group.name, f"more than {DEEPEST} groups inside each other")
    key = h5py.h5o.get_info(group.id).addr
    if key in seen:
        raise _refused(where, group.name, "a group that is linked twice, or lies inside itself")
    seen.add(key)
    for name in group:
        link, place = group.get(name, getlink=True), f"{group.name}/{name}"
        if isinstance(link, h5py.ExternalLink):
            raise _refused(where, place, f"a link to the file {link.filename!r}")
        if isinstance(link, h5py.SoftLink) and group.get(name) is None:
            raise _refused(where, place, f"a link to {link.path!r}, nowhere")
        item = group[name]
        if isinstance(item, h5py.Group):
            _check(item, where, seen, depth + 1)
        elif isinstance(item, h5py.Dataset):
            if item.external or item.is_virtual:
                raise _refused(where, place, "its numbers are in another file or dataset")
            size = (item.size or 0) * max(item.dtype.itemsize, 8)
            if size > MOST_BYTES:
                raise _refused(where, place, f"{item.size:,} values")
            current().demand_decoded(size, item.id.get_storage_size(), f"{where}, {place}")


def _refused(where: str, name: str, problem: str) -> SourceError:
    return SourceError(
        where, f"{name}: {problem}.", "files that hold their own numbers",
        "do not trust this file, or copy it with h5repack",
    )  # fmt: skip


def rows(group: Any, key: str, where: str, width: int | None = None) -> NDArray[np.float64]:
    """Return (T, k) float64 of one dataset; (T,) becomes (T, 1).

    Raises:
        TraceError: it is not there, no numbers, or not ``width`` wide.
    """
    data = group.get(key)
    if data is None or not hasattr(data, "shape"):
        inside = ", ".join(sorted(group)) or "nothing"
        raise TraceError(where, f"{key!r} is missing.", f"there are {inside}")
    try:
        values = np.asarray(data[()], np.float64)
    except (ValueError, TypeError, OSError) as error:
        raise TraceError(f"{where}/{key}", f"cannot be read: {error}.") from None
    if not values.ndim or not values.size:
        raise TraceError(f"{where}/{key}", f"has no rows: its shape is {values.shape}.")
    values = values.reshape(len(values), -1)
    if width is not None and values.shape[1] != width:
        raise TraceError(
            f"{where}/{key}", f"{values.shape[1]} numbers in a row.", f"{width} numbers"
        )
    return values


@contextmanager
def layout(where: str) -> Iterator[None]:
    """Raise TraceError where the block reads an unexpected layout or damaged data."""
    try:
        yield
    except InputError:
        raise
    except (OSError, RuntimeError) as error:
        raise TraceError(where, f"cannot be read: {error}.") from None
    except (AttributeError, TypeError, KeyError, IndexError, ValueError, OverflowError) as error:
        lines = str(error).splitlines() or [type(error).__name__]
        raise TraceError(where, f"is laid out in another way: {lines[0][:200]}.") from None


def fingerprint(group: Any) -> str:
    """Return a digest of a group: names, shapes and types of all datasets below, and the ends of each."""
    digest = sha256()
    with layout(str(group.name)):
        for name, data in datasets(group):
            digest.update(f"{name} {data.shape} {data.dtype}".encode())
            if data.shape and data.shape[0]:
                digest.update(np.ascontiguousarray(data[0]).tobytes())
                digest.update(np.ascontiguousarray(data[-1]).tobytes())
    return digest.hexdigest()


def datasets(group: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (path below the group, dataset) of every dataset, by name."""
    for name in sorted(group):
        item = group[name]
        if hasattr(item, "shape"):
            yield f"{prefix}{name}", item
        elif hasattr(item, "keys"):  # the rest are types with a name
            yield from datasets(item, f"{prefix}{name}/")


def numbered(names: Any) -> list[str]:
    """Sort names by the number at their end: ``demo_10`` after ``demo_9``."""

    def key(name: str) -> tuple[str, int, str]:
        stem = name.rstrip("0123456789")
        number = name[len(stem) :]
        return stem, int(number) if number else -1, name

    return sorted(names, key=key)


def demos(file: Any) -> list[Any]:
    """The groups of demonstrations below ``data``, in order; none where there is no such group."""
    data = file.get("data")
    names = numbered(data) if hasattr(data, "keys") else []
    return [data[name] for name in names if hasattr(data[name], "keys")]
