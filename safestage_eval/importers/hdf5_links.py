"""Links in an HDF5 file from a stranger that lead out of the file: refused.

A dataset can have its numbers in any other file of this machine (external storage, virtual
datasets), a link can lead into another file, and links can lead round in a circle, or to so few groups
by so many ways that nobody comes to an end.
"""

from __future__ import annotations

from typing import Any

from safestage_eval.size_limits import current

from .importer import SourceError

DEEPEST = 32
"""Groups inside each other."""

MOST_WAYS = 10_000
"""To things that are there once and linked again; hardly any file has one."""

MOST_BYTES = 1 << 33
"""Bytes that one dataset may unpack to."""


def check_links(file: Any, where: str) -> None:
    """Look at every group and dataset of an open file.

    Raises:
        SourceError: something leads out of the file, or round in a circle, or would not fit into
            memory.
    """
    try:
        unfolded: dict[Any, Unfolded] = {}
        ways, _ = _group(file, where, (_key(file),), unfolded)
        there = len(file) + sum(own for _, _, own in unfolded.values())
        if ways > there + MOST_WAYS:
            raise _refused(where, "its links", f"{ways:,} ways to {there:,} things")
    except (RuntimeError, KeyError, OSError, ValueError) as error:
        lines = str(error).strip("'\"").splitlines() or [type(error).__name__]
        raise SourceError(
            where, f"a damaged HDF5 file: {lines[0]}.", fix="download it again"
        ) from None


Unfolded = tuple[int, int, int]
"""Counts of a group: entries below it by every path, nesting depth, entries of its own."""


def _group(
    group: Any, where: str, trail: tuple[Any, ...], unfolded: dict[Any, Unfolded]
) -> tuple[int, int]:
    import h5py

    entries, height = 0, 0
    for name in group:
        link = group.get(name, getlink=True)
        if isinstance(link, h5py.ExternalLink):
            raise _refused(where, f"{group.name}/{name}", f"a link to the file {link.filename!r}")
        if isinstance(link, h5py.SoftLink) and group.get(name) is None:
            raise _refused(where, f"{group.name}/{name}", f"a link to {link.path!r}, nowhere")
        entries += 1
        item = group[name]
        if isinstance(item, h5py.Group):
            key = _key(item)
            if key in trail:
                raise _refused(where, f"{group.name}/{name}", "a group inside itself")
            if key not in unfolded:
                if len(trail) == DEEPEST:
                    raise _too_deep(where, item.name)
                unfolded[key] = (*_group(item, where, (*trail, key), unfolded), len(item))
            inside, below, _ = unfolded[key]
            entries, height = entries + inside, max(height, below + 1)
        elif isinstance(item, h5py.Dataset):
            _dataset(item, where)
    if len(trail) + height > DEEPEST:
        raise _too_deep(where, group.name)
    return entries, height


def _key(item: Any) -> tuple[int, Any]:
    """Return an identity of a group that does not depend on the links to it."""
    import h5py

    info = h5py.h5o.get_info(item.id)
    return info.fileno, info.addr


def _too_deep(where: str, name: str) -> SourceError:
    return _refused(where, name, f"more than {DEEPEST} groups inside each other")


def _dataset(data: Any, where: str) -> None:
    if data.external:
        raise _refused(where, data.name, f"numbers in the file {data.external[0][0]!r}")
    if data.is_virtual:
        raise _refused(where, data.name, "numbers in other datasets (a virtual dataset)")
    if data.size is not None:
        size = data.size * max(data.dtype.itemsize, 8)
        if size > MOST_BYTES:
            raise _refused(where, data.name, f"{data.size:,} values")
        stored = data.id.get_storage_size()
        current().demand_decoded(size, stored, f"{where}, {data.name}")


def _refused(where: str, name: str, problem: str) -> SourceError:
    return SourceError(
        where,
        f"{name}: {problem}.",
        "files that hold their own numbers",
        "do not trust this file, or copy it with h5repack",
    )
