"""One file of small answers: a line each, added as they come, never rewritten.

A line is a key, a checksum and JSON. Any number of processes may add lines to the same file; a line
that was cut off or damaged is ignored. The key covers everything that the answer depends on.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from uuid import uuid4

KEY = 32
"""Characters of a key."""

_READ = os.O_RDONLY | getattr(os, "O_BINARY", 0)
_APPEND = os.O_WRONLY | os.O_APPEND | os.O_CREAT | getattr(os, "O_BINARY", 0)


_json = json.JSONEncoder(separators=(",", ":")).encode


class Log:
    """The answers in a file, each looked at when it is asked for."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._lines: dict[bytes, bytes] | None = None

    @classmethod
    def read(cls, path: str | Path) -> Log:
        """All answers in a file; none when there is no such file."""
        try:
            file = os.open(path, _READ)
        except OSError:
            return cls(b"")
        parts = []
        try:
            while part := os.read(file, 1 << 20):
                parts.append(part)
        except OSError:
            return cls(b"")
        finally:
            os.close(file)
        return cls(b"".join(parts))

    def get(self, key: str) -> Any:
        """The answer under a key, JSON; None where there is none."""
        if self._lines is None:  # the last line of a key is the one that counts
            self._lines = {line[:KEY]: line for line in self._data.split(b"\n")}
            self._data = b""
        line = self._lines.get(key.encode())
        if line is None:
            return None
        text = line[KEY + 10 :]
        if line[KEY + 1 : KEY + 9] != _checksum(key, text):
            return None
        return json.loads(text.decode())


def append(path: str | Path, answers: Mapping[str, Any], *, most: int) -> None:
    """Add answers (JSON) to a file, in one write; one of more than ``most`` bytes is begun anew.

    Raises OSError.
    """
    lines = []
    for key, value in answers.items():
        text = _json(value).encode()
        lines.append(b"\n" + key.encode() + b" " + _checksum(key, text) + b" " + text)
    data = b"".join(lines) + b"\n"
    try:
        file = os.open(path, _APPEND, 0o666)
    except FileNotFoundError:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        file = os.open(path, _APPEND, 0o666)
    try:
        if os.lseek(file, 0, os.SEEK_END) <= most:
            os.write(file, data)
            return
    finally:
        os.close(file)
    place = Path(path)
    new = place.with_name(f".{place.name}.{uuid4().hex[:8]}.part")
    new.write_bytes(data)
    new.replace(place)


def _checksum(key: str, text: bytes) -> bytes:
    return f"{zlib.crc32(text, zlib.crc32(key.encode())):08x}".encode()
