"""Files that exist whole or not at all."""

from __future__ import annotations

import os
import re
import shutil
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO
from uuid import uuid4

PART = ".part"
"""Ending of files that are being written; no reader looks at them."""

_DESCRIPTOR = re.compile(r"/dev/(fd/\d+|stdout|stderr)|/proc/self/fd/\d+")


@contextmanager
def writing(path: Path) -> Iterator[Path]:
    """Yield a temporary path whose content goes to the output that a user named when the block ends well.

    A file appears whole or not at all; of a link, it is the target that is replaced. What is no
    file (a device, a pipe, /dev/stdout) is written to and stays what it is.
    """
    if not is_stream(path):
        with replacing(Path(os.path.realpath(path))) as part:
            yield part
        return
    with TemporaryDirectory() as folder:
        part = Path(folder) / "output"
        yield part
        with part.open("rb") as content, _stream(path) as stream:
            shutil.copyfileobj(content, stream)


def is_stream(path: Path) -> bool:
    """True of what is neither a file nor a folder: a device, a pipe, a descriptor such as /dev/stdout."""
    if _DESCRIPTOR.fullmatch(str(path)):
        return True
    try:
        mode = path.stat().st_mode
    except OSError:
        return False
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def _stream(path: Path) -> BinaryIO:
    """Open what ``is_stream``; a descriptor is not opened anew, which would empty the file it writes to."""
    if not _DESCRIPTOR.fullmatch(str(path)):
        return path.open("wb")
    sys.stdout.flush()
    return os.fdopen(os.dup({"stdout": 1, "stderr": 2}.get(path.name) or int(path.name)), "wb")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside ``path`` that takes its place when the block ends well.

    The bytes are on disk before the name changes; a block that raises leaves nothing behind, and
    one that is killed leaves only a ``.part`` file.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{uuid4().hex[:8]}{PART}")
    try:
        yield part
        sync(part)
        part.replace(path)
        sync(path.parent)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file whole or not at all."""
    with replacing(path) as part:
        part.write_bytes(data)


def write_output(path: Path, data: bytes) -> None:
    """Write to an output that a user named, as ``writing``."""
    with writing(path) as part:
        part.write_bytes(data)


def sync(path: Path) -> None:
    """Flush the bytes of a file, or the names in a folder where the system can, to the disk."""
    if os.name == "nt" and path.is_dir():
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
