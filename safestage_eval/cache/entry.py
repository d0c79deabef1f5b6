"""One file of the cache: named values, most of them arrays, each with its checksum.

Layout: magic, length of the index (8 bytes), checksum of the index (4), index as JSON, padding to
8 bytes, arrays. An array that is constant, or changes seldom, is kept as its runs.
"""

from __future__ import annotations

import json
import os
import zlib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC = b"SSCACHE2"
_HEAD = len(MAGIC) + 12
_FIRST = 1 << 16
"""Bytes that are read at first; the index is seldom longer."""

Value = dict[str, Any]
"""JSON values and arrays by name."""


class Entry:
    """What one file holds; arrays are read when they are asked for.

    Every read checks a checksum: bytes that are not what was written are a miss. A file that is
    replaced meanwhile is read on as it was.
    """

    def __init__(self, file: int) -> None:
        """``file``: a descriptor, which is closed when nobody holds the entry any more."""
        self._file, self._start, self._first = file, 0, b""
        self._index: dict[str, dict[str, Any]] = {}

    def __del__(self) -> None:
        """Closes the file."""
        os.close(self._file)

    @classmethod
    def read(cls, path: str | Path) -> Entry | None:
        """The entry in a file; None when there is none, or not a whole one."""
        try:
            found = cls(os.open(path, os.O_RDONLY | getattr(os, "O_BINARY", 0)))
        except OSError:
            return None
        return found if found._understood() else None

    def _understood(self) -> bool:
        """Reads the index; False where the file is not a whole one."""
        data = self._first = self._bytes(0, _FIRST)
        size = int.from_bytes(data[len(MAGIC) : len(MAGIC) + 8], "little")
        if _HEAD + size > len(data) == _FIRST and _HEAD + size <= os.fstat(self._file).st_size:
            data = self._bytes(0, _HEAD + size)
        told = int.from_bytes(data[len(MAGIC) + 8 : _HEAD], "little")
        text = data[_HEAD : _HEAD + size]
        if not data.startswith(MAGIC) or len(text) != size or zlib.crc32(text) != told:
            return False
        self._index, self._start = json.loads(text), _HEAD + size + -(_HEAD + size) % 8
        return True

    def _bytes(self, at: int, count: int) -> bytes:
        """So many bytes of the file, or as many as there are."""
        if at + count <= len(self._first):
            return self._first[at : at + count]
        try:
            os.lseek(self._file, at, os.SEEK_SET)
            return os.read(self._file, count)
        except OSError:
            return b""

    def names(self) -> list[str]:
        """Of all values."""
        return list(self._index)

    def get(self, name: str) -> Value | None:
        """A value; None where there is none, or its bytes are damaged."""
        stored = self._index.get(name)
        if stored is None:
            return None
        found: Value = {}
        for key, item in stored.items():
            if not (isinstance(item, dict) and "dtype" in item):
                found[key] = item
                continue
            array = self._array(item)
            if array is None:
                return None
            found[key] = array
        return found

    def _array(self, item: dict[str, Any]) -> NDArray[Any] | None:
        raw = self._bytes(self._start + item["at"], item["bytes"])
        if len(raw) != item["bytes"] or _sum(raw) != item["sum"]:
            return None
        length, dtype = item["length"], np.dtype(item["dtype"])
        if item["runs"] is None:
            return np.frombuffer(raw, dtype)
        starts = np.frombuffer(raw[: 4 * item["runs"]], np.int32)
        values = np.frombuffer(raw[-(-4 * item["runs"] // 8) * 8 :], dtype)
        lengths = np.append(starts[1:], np.int32(length)) - starts if len(starts) else starts
        out = np.repeat(values, lengths)
        out.flags.writeable = False
        return out


def encode(values: Mapping[str, Value]) -> bytes:
    """The bytes of an entry."""
    index: dict[str, dict[str, Any]] = {}
    blocks: list[bytes] = []
    at = 0
    for name, value in values.items():
        index[name] = {}
        for key, item in value.items():
            if not isinstance(item, np.ndarray):
                index[name][key] = item
                continue
            raw, runs = _packed(item)
            index[name][key] = {
                "dtype": item.dtype.str,
                "length": len(item),
                "runs": runs,
                "at": at,
                "bytes": len(raw),
                "sum": _sum(raw),
            }
            raw += bytes(-len(raw) % 8)
            blocks.append(raw)
            at += len(raw)
    text = json.dumps(index, separators=(",", ":")).encode()
    head = MAGIC + len(text).to_bytes(8, "little") + zlib.crc32(text).to_bytes(4, "little")
    return head + text + bytes(-(len(head) + len(text)) % 8) + b"".join(blocks)


def _sum(raw: bytes) -> str:
    """A checksum that is fast on arrays: bytes as a vector times fixed odd numbers, modulo 2⁶⁴."""
    words = np.frombuffer(raw + bytes(-len(raw) % 8), np.uint64)
    return f"{int(words @ _factors(1 << len(words).bit_length())[: len(words)]):x}"


@lru_cache(maxsize=24)
def _factors(count: int) -> NDArray[np.uint64]:
    return np.arange(1, 2 * count, 2, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)


def _packed(array: NDArray[Any]) -> tuple[bytes, int | None]:
    """Bytes of an array, and the number of its runs where these are shorter."""
    array = np.ascontiguousarray(array)
    bits = array.view(f"u{array.itemsize}")  # −0 and 0 differ, and so do NaNs
    starts = np.flatnonzero(np.concatenate([[len(array) > 0], bits[1:] != bits[:-1]]))
    if len(starts) * (4 + array.itemsize) >= array.nbytes:
        return array.tobytes(), None
    places = starts.astype(np.int32).tobytes()
    return places + bytes(-len(places) % 8) + array[starts].tobytes(), len(starts)
