"""One file of small answers: a line each, added as they come, never rewritten.

A line is a key, a checksum and JSON. Any number of processes may add lines to the same file; a line
that was cut off or damaged is none. What an answer depends on is all in its key.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from uuid import uuid4

MOST = 1 << 18
"""Bytes; a file that is longer is begun anew. A verdict takes about one kilobyte."""


class Log:
    """The answers in a file, each looked at when it is asked for."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    @classmethod
    def read(cls, path: str | Path) -> Log:
        """All answers in a file; none when there is no such file."""
        try:
            with open(path, "rb", buffering=0) as file:  # noqa: PTH123 - fast
                return cls(file.readall())
        except OSError:
            return cls(b"")

    def get(self, key: str) -> Any:
        """The answer under a key, JSON; None where there is none."""
        start = self._data.rfind(b"\n" + key.encode() + b" ")
        if start < 0:
            return None
        end = self._data.find(b"\n", start + 1)
        line = self._data[start + 1 : end if end >= 0 else None]
        text = line[len(key) + 10 :]
        if line[len(key) + 1 : len(key) + 9] != _checksum(key, text):
            return None
        return json.loads(text)


def append(path: Path, answers: Mapping[str, Any]) -> None:
    """Add answers (JSON) to a file, in one write. Raises OSError."""
    lines = []
    for key, value in answers.items():
        text = json.dumps(value, separators=(",", ":")).encode()
        lines.append(b"\n" + key.encode() + b" " + _checksum(key, text) + b" " + text)
    data = b"".join(lines) + b"\n"
    try:
        file = path.open("ab", buffering=0)
    except FileNotFoundError:
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("ab", buffering=0)
    with file:
        if file.tell() <= MOST:
            file.write(data)
            return
    new = path.with_name(f".{path.name}.{uuid4().hex[:8]}.part")
    new.write_bytes(data)
    new.replace(path)


def _checksum(key: str, text: bytes) -> bytes:
    return f"{zlib.crc32(text, zlib.crc32(key.encode())):08x}".encode()
