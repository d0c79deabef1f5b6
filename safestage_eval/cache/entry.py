"""One file of the cache: named values, most of them arrays, each with its checksum.

Layout: magic, length of the index (8 bytes), checksum of the index (4), index as JSON, padding to
8 bytes, arrays. An array that is constant, or changes seldom, is kept as its runs.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
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

    Every read checks a checksum: bytes that are not what was written are a miss, and so are those
    of a file that was replaced meanwhile.
    """

    def __init__(self, path: Path, index: dict[str, dict[str, Any]], start: int) -> None:
        self._path, self._index, self._start = path, index, start

    @classmethod
    def read(cls, path: Path) -> Entry | None:
        """The entry in a file; None when there is none, or not a whole one."""
        try:
            with path.open("rb", buffering=0) as file:
                data = file.read(_FIRST)
                size = int.from_bytes(data[len(MAGIC) : len(MAGIC) + 8], "little")
                if _HEAD + size > len(data) and size < path.stat().st_size:
                    data += file.read(_HEAD + size - len(data))
        except OSError:
            return None
        told = int.from_bytes(data[len(MAGIC) + 8 : _HEAD], "little")
        text = data[_HEAD : _HEAD + size]
        if not data.startswith(MAGIC) or len(text) != size or zlib.crc32(text) != told:
            return None
        return cls(path, json.loads(text), _HEAD + size + -(_HEAD + size) % 8)

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
        try:
            with self._path.open("rb", buffering=0) as file:
                file.seek(self._start + item["at"])
                raw = file.read(item["bytes"])
        except OSError:
            return None
        if len(raw) != item["bytes"] or _sum(raw) != item["sum"]:
            return None
        length, dtype = item["length"], np.dtype(item["dtype"])
        if item["runs"] is None:
            return np.frombuffer(raw, dtype)
        starts = np.frombuffer(raw[: 4 * item["runs"]], np.int32)
        values = np.frombuffer(raw[-(-4 * item["runs"] // 8) * 8 :], dtype)
        out = np.repeat(values, np.diff(starts, append=length))
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
    factors = np.arange(1, 2 * len(words), 2, dtype=np.uint64) * np.uint64(0x9E3779B97F4A7C15)
    return f"{int(words @ factors):x}"


def _packed(array: NDArray[Any]) -> tuple[bytes, int | None]:
    """Bytes of an array, and the number of its runs where these are shorter."""
    array = np.ascontiguousarray(array)
    bits = array.view(f"u{array.itemsize}")  # −0 and 0 differ, and so do NaNs
    starts = np.flatnonzero(np.concatenate([[len(array) > 0], bits[1:] != bits[:-1]]))
    if len(starts) * (4 + array.itemsize) >= array.nbytes:
        return array.tobytes(), None
    places = starts.astype(np.int32).tobytes()
    return places + bytes(-len(places) % 8) + array[starts].tobytes(), len(starts)
