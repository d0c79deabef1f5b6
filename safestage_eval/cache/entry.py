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

MAGIC = b"SSCACHE1"
_HEAD = len(MAGIC) + 12

Value = dict[str, Any]
"""JSON values and arrays by name."""


class Entry:
    """What one file holds; arrays are looked at when they are asked for.

    Every read checks a checksum: bytes that are not what was written are a miss.
    """

    def __init__(self, data: bytes, index: dict[str, dict[str, Any]], start: int) -> None:
        self._data, self._index, self._start = data, index, start

    @classmethod
    def read(cls, path: Path) -> Entry | None:
        """The entry in a file; None when there is none, or not a whole one."""
        try:
            data = path.read_bytes()
        except OSError:
            return None
        if data[: len(MAGIC)] != MAGIC or len(data) < _HEAD:
            return None
        size = int.from_bytes(data[len(MAGIC) : len(MAGIC) + 8], "little")
        told = int.from_bytes(data[len(MAGIC) + 8 : _HEAD], "little")
        text = data[_HEAD : _HEAD + size]
        if len(text) != size or zlib.crc32(text) != told:
            return None
        start = _HEAD + size + -(_HEAD + size) % 8
        return cls(data, json.loads(text), start)

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
        begin = self._start + item["at"]
        raw = memoryview(self._data)[begin : begin + item["bytes"]]
        if len(raw) != item["bytes"] or zlib.crc32(raw) != item["crc"]:
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
                "crc": zlib.crc32(raw),
            }
            raw += bytes(-len(raw) % 8)
            blocks.append(raw)
            at += len(raw)
    text = json.dumps(index, separators=(",", ":")).encode()
    head = MAGIC + len(text).to_bytes(8, "little") + zlib.crc32(text).to_bytes(4, "little")
    return head + text + bytes(-(len(head) + len(text)) % 8) + b"".join(blocks)


def _packed(array: NDArray[Any]) -> tuple[bytes, int | None]:
    """Bytes of an array, and the number of its runs where these are shorter."""
    array = np.ascontiguousarray(array)
    bits = array.view(f"u{array.itemsize}")  # −0 and 0 differ, and so do NaNs
    starts = np.flatnonzero(np.concatenate([[len(array) > 0], bits[1:] != bits[:-1]]))
    if len(starts) * (4 + array.itemsize) >= array.nbytes:
        return array.tobytes(), None
    places = starts.astype(np.int32).tobytes()
    return places + bytes(-len(places) % 8) + array[starts].tobytes(), len(starts)
