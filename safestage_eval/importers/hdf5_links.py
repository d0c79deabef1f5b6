"""What an HDF5 file may not hold when it comes from a stranger: ways out of the file.

A dataset can have its numbers in any other file of this machine (external storage, virtual
datasets), a link can lead into another file, and hard links can lead round in a circle.
"""

from __future__ import annotations

from typing import Any

from .importer import SourceError

DEEPEST = 32
"""Groups inside each other."""

MOST_BYTES = 1 << 33
"""That one dataset may unpack to."""


def check_links(file: Any, where: str) -> None:
    """Look at every group and dataset of an open file.

    Raises:
        SourceError: something leads out of the file, or round in a circle, or would not fit into
            memory.
    """
    try:
        _group(file, where, (file.id,))
    except (RuntimeError, KeyError, OSError, ValueError) as error:
        told = str(error).strip("'\"").splitlines() or [type(error).__name__]
        raise SourceError(
            where, f"a damaged HDF5 file: {told[0]}.", fix="download it again"
        ) from None


def _group(group: Any, where: str, trail: tuple[Any, ...]) -> None:
    import h5py

    if len(trail) > DEEPEST:
        raise _refused(where, group.name, f"more than {DEEPEST} groups inside each other")
    for name in group:
        link = group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise _refused(where, f"{group.name}/{name}", f"a link to the file {link.filename!r}")
        if isinstance(link, h5py.SoftLink):
            if group.get(name) is None:
                raise _refused(where, f"{group.name}/{name}", f"a link to {link.path!r}, nowhere")
            continue  # it leads to what is looked at elsewhere
        item = group[name]
        if isinstance(item, h5py.Group):
            if any(item.id == seen for seen in trail):
                raise _refused(where, item.name, "a group inside itself")
            _group(item, where, (*trail, item.id))
        elif isinstance(item, h5py.Dataset):
            _dataset(item, where)


def _dataset(data: Any, where: str) -> None:
    if data.external:
        raise _refused(where, data.name, f"numbers in the file {data.external[0][0]!r}")
    if data.is_virtual:
        raise _refused(where, data.name, "numbers in other datasets (a virtual dataset)")
    if data.size is not None and data.size * max(data.dtype.itemsize, 8) > MOST_BYTES:
        raise _refused(where, data.name, f"{data.size:,} values")


def _refused(where: str, name: str, what: str) -> SourceError:
    return SourceError(
        where,
        f"{name}: {what}.",
        "files that hold their own numbers",
        "do not trust this file, or copy it with h5repack",
    )
