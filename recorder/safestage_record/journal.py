"""The file that a running recording grows by, and what is read back from it after its process died.

A journal begins with ``MAGIC``. Then come records: their length and CRC-32, and in them JSON
followed by NumPy arrays. A record that is cut off or damaged ends what can be read.
"""

from __future__ import annotations

import io
import json
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

MAGIC = b"safestage-journal 1\n"
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
        body = io.BytesIO()
        text = json.dumps({"facts": facts, "names": list(arrays)}).encode()
        body.write(_SIZE.pack(len(text)) + text)
        for values in arrays.values():
            np.lib.format.write_array(body, np.ascontiguousarray(values), allow_pickle=False)
        content = body.getbuffer()
        try:
            self._stream.write(_HEAD.pack(len(content), zlib.crc32(content)) + content)
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
    stream = io.BytesIO(body)
    (size,) = _SIZE.unpack(stream.read(_SIZE.size))
    said = json.loads(stream.read(size))
    arrays = {n: np.lib.format.read_array(stream, allow_pickle=False) for n in said["names"]}
    return said["facts"], arrays


def _refuse_running(stream: Any, path: Path) -> None:
    """Raise RecordError where the process that writes the journal is alive."""
    if fcntl is None:
        return
    try:
        fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        raise RecordError(f"{path}: is being recorded by a process that runs.") from None
