"""The file that a running recording grows by, and what is read back from it after its process died.

A journal begins with ``MAGIC``. Then come records: their length and CRC-32, and in them JSON, which
says what arrays they hold, followed by the arrays' bytes. A record that is cut off or damaged ends what can be read.
"""

from __future__ import annotations

import json
import math
import struct
import zlib
from pathlib import Path
from typing import Any, Mapping

import numpy as np

from .record_error import RecordError

fcntl: Any
try:
    import fcntl
except ImportError:  # Windows has no such locks; there nobody may read a running recording
    fcntl = None

MAGIC = b"safestage-journal 2\n"
SUFFIX = ".unfinished"
"""Suffix of the journal's name after the name of the trace."""

_HEAD = struct.Struct("<QI")
_SIZE = struct.Struct("<I")


class Journal:
    """Appends records to a file. What was appended outlives the process, however it ends.

    A record reaches the operating system at once, not the disk: it does not outlive a power cut.
    """

    def __init__(self, path: Path) -> None:
        """Begin a journal at ``path``. Raises RecordError where it cannot be written, or is there."""
        self.path = path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = path.open("xb", buffering=0)
            if fcntl is not None:
                fcntl.flock(self._stream, fcntl.LOCK_EX)
            self._stream.write(MAGIC)
        except FileExistsError:
            raise RecordError(
                f"{path}: is there already, of a recording that runs or died. To make a trace of "
                f"it: python -m safestage_record recover {path}"
            ) from None
        except OSError as error:
            raise RecordError(f"{path}: cannot be written: {error.strerror or error}.") from error

    def append(self, facts: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
        """Append a record of JSON and arrays by name. Raises RecordError where it cannot be written."""
        kept = {name: np.ascontiguousarray(values) for name, values in arrays.items()}
        about = {
            name: (np.lib.format.dtype_to_descr(values.dtype), values.shape)
            for name, values in kept.items()
        }
        text = json.dumps({"facts": facts, "arrays": about}).encode()
        parts: list[Any] = [_SIZE.pack(len(text)), text, *kept.values()]
        crc = 0
        for part in parts:
            crc = zlib.crc32(part, crc)
        size = len(text) + _SIZE.size + sum(values.nbytes for values in kept.values())
        try:
            for part in (_HEAD.pack(size, crc), *parts):
                self._stream.write(part)
        except OSError as error:
            raise RecordError(
                f"{self.path}: cannot be written: {error.strerror or error}."
            ) from error

    def remove(self) -> None:
        """Close the file and delete it."""
        self._stream.close()
        if self.path.exists():
            self.path.unlink()


def read_journal(path: Path) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Return the whole records of a journal, (JSON, arrays) each.

    Raises:
        RecordError: no journal, or its recording is still running.
    """
    try:
        with path.open("rb") as stream:
            _refuse_running(stream, path)
            content = stream.read()
    except OSError as error:
        raise RecordError(f"{path}: cannot be read: {error.strerror or error}.") from error
    if not content.startswith(MAGIC):
        raise RecordError(f"{path}: not the journal of a recording.")
    records, at = [], len(MAGIC)
    while at + _HEAD.size <= len(content):
        size, crc = _HEAD.unpack_from(content, at)
        body = content[at + _HEAD.size : at + _HEAD.size + size]
        if len(body) < size or zlib.crc32(body) != crc:
            break
        records.append(_record(body))
        at += _HEAD.size + size
    return records


def _record(body: bytes) -> tuple[dict[str, Any], dict[str, Any]]:
    (size,) = _SIZE.unpack_from(body)
    at = _SIZE.size + size
    said = json.loads(body[_SIZE.size : at])
    arrays = {}
    for name, (described, shape) in said["arrays"].items():
        kind = np.dtype(
            [tuple(field) for field in described] if isinstance(described, list) else described
        )
        count = math.prod(shape)
        arrays[name] = np.frombuffer(body, kind, count, at).reshape(shape).copy()
        at += count * kind.itemsize
    return said["facts"], arrays


def _refuse_running(stream: Any, path: Path) -> None:
    """Raise RecordError where the process that writes the journal is alive."""
    if fcntl is None:
        return
    try:
        fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        raise RecordError(f"{path}: is being recorded by a process that runs.") from None
