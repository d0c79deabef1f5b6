"""Files that a trace is read from: regular ones, and inside its folder whatever names it holds."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable
from pathlib import Path

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


def existing(folder: Path, place: str, names: Iterable[str], where: str) -> list[str]:
    """Return the names that exist; raises the errors of ``within``.

    Looks at each file once, and at the folders around them once.
    """
    inside = f"{folder / place}/"
    linked = isinstance(folder, RemotePath) or _is_link(inside[:-1]) or _is_link(str(folder))
    existing: list[str] = []
    for name in names:
        try:
            mode = 0 if linked else os.lstat(inside + _plain(name, place, where)).st_mode
        except (FileNotFoundError, NotADirectoryError):
            continue
        if (linked or not stat.S_ISREG(mode)) and not inside_dataset(
            folder, place, name, where
        ).exists():
            continue
        existing.append(name)
    return existing


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
