"""Files that a trace is read from: regular ones, and inside its folder whatever names it holds."""

from __future__ import annotations

import os
import stat
from collections.abc import Hashable, Iterable
from pathlib import Path

import pyarrow as pa

from safestage_eval.errors import TraceError

from .remote_path import RemotePath


def regular_status(path: Path) -> os.stat_result:
    """Return size and times of a file that can be read to its end.

    Raises:
        OSError: it is not there, or a link to itself.
        TraceError: a folder, a pipe or a device, of which reading might never end.
    """
    status = path.stat()
    if isinstance(path, RemotePath):
        return status
    if not stat.S_ISREG(status.st_mode):
        raise TraceError(
            str(path),
            f"{_kind(status.st_mode)}, not a file.",
            "regular files",
            "copy the data again",
        )
    return status


def inside_dataset(folder: Path, place: str, name: object, where: str) -> Path:
    """Return the path of a file that stored data names, in a folder of the dataset.

    Args:
        folder: of the dataset.
        place: the folder in there.
        name: of the file; it may not hold folders.
        where: place that messages name.

    Raises:
        TraceError: the name leads elsewhere, or the file is a link to outside of the dataset.
    """
    path = folder / place / _plain(name, place, where)
    check_link(path, folder, where)
    return path


def lacking(folder: Path, names: Iterable[str]) -> list[str]:
    """Return the names that are not in a folder; those that are may still be links to elsewhere."""
    if isinstance(folder, RemotePath):
        return [name for name in names if not (folder / name).exists()]
    place = str(folder)
    return [name for name in names if not os.path.lexists(f"{place}/{name}")]


def file_state(path: Path) -> tuple[Hashable, int]:
    """Return what is another when the content of a file is another, and its size. Raises as ``regular_status``."""
    if isinstance(path, RemotePath):
        opened = path.opened()
        return opened.state, opened.size
    status = regular_status(path)
    state = status.st_mtime_ns, status.st_ctime_ns, status.st_size, status.st_ino
    return state, status.st_size


def arrow_file(path: Path, mode: str = "rb") -> pa.NativeFile:
    """Open a file for pyarrow, whose own functions take no path that is not UTF-8."""
    if isinstance(path, RemotePath):
        return path.opened().file
    return pa.OSFile(os.fsencode(path), mode)


def _is_link(path: str) -> bool:
    return os.path.islink(path)  # noqa: PTH114


def _plain(name: object, place: str, where: str) -> str:
    """A name of a file and of nothing else."""
    text = name if isinstance(name, str) else ""
    if (
        text in ("", ".", "..")
        or len(text.encode("utf-8", "replace")) > 255
        or set(text) & set("/\\\0:")
        or not text.isprintable()
    ):
        raise TraceError(
            where,
            f"the file name {str(name)[:80]!r} is none in {place}.",
            f"names of files in {place}",
            "do not trust this dataset, or ask who made it",
        )
    return text


def check_link(path: Path, folder: Path, where: str) -> None:
    """Raise for a link to outside of the dataset, or of the hub's cache that the dataset is in."""
    if isinstance(path, RemotePath):
        return  # an object store has no links
    place = str(path)  # plain text takes a third of the time, and every file comes this way
    for _ in range(3):
        if _is_link(place):
            break
        place = os.path.dirname(place)  # noqa: PTH120
    else:
        return
    root = Path(os.path.realpath(folder))
    for parent in root.parents:
        if parent.name == "snapshots" and parent.parent.name.startswith("datasets--"):
            root = parent.parent
    if not Path(os.path.realpath(path)).is_relative_to(root):
        raise TraceError(
            where,
            f"{path} is a link to outside of the dataset.",
            f"links within {root}",
            "copy the file in place of the link, or link the whole folder",
        )


def _kind(mode: int) -> str:
    kinds = {
        stat.S_IFDIR: "a folder",
        stat.S_IFIFO: "a pipe",
        stat.S_IFSOCK: "a socket",
        stat.S_IFCHR: "a device",
        stat.S_IFBLK: "a device",
    }
    return kinds.get(stat.S_IFMT(mode), "something else")
