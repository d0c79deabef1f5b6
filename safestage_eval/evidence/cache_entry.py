"""One file of the cache: named values, most of them arrays, each with its checksum.

Layout: magic; lengths of two indices and their checksums (4 bytes each); the indices as JSON, first
of values without arrays, then of those with some; padding to 8 bytes; arrays, padded likewise. An array
that is constant, or changes seldom, is kept as its runs.
"""

from __future__ import annotations

import json
import os
import struct
import zlib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAGIC = b"SSCACHE3"
_LENGTHS = struct.Struct("<8sIIII")
_FIRST = 1 << 14
"""Bytes that are read at first; the indices are seldom longer."""
_ARRAY = ""
"""Name under which the place of an array stands: first byte, count of bytes, of values, and of runs
(or None), type, checksum."""

Value = dict[str, Any]
"""JSON values and arrays by name."""


class Entry:
    """Contents of one cache file; arrays are read on demand.

    Every read checks a checksum: bytes that are not what was written are a miss. A file that is
    replaced meanwhile is read on as it was.
    """

    def __init__(self, file: int) -> None:
        """``file``: a descriptor, which is closed when nobody holds the entry any more."""
        self._file, self._start, self._first = file, 0, b""
        self._plain: dict[str, Value] = {}
        self._text: bytes = b""
        self._index: dict[str, Value] | None = None

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
        """Reads the indices; False where the file is not a whole one."""
        data = self._first = self._bytes(0, _FIRST)
        if len(data) < _LENGTHS.size or not data.startswith(MAGIC):
            return False
        _, plain, arrays, *sums = _LENGTHS.unpack_from(data)
        middle, end = _LENGTHS.size + plain, _LENGTHS.size + plain + arrays
        if end > len(data) == _FIRST and end <= os.fstat(self._file).st_size:
            data = self._bytes(0, end)
        texts = data[_LENGTHS.size : middle], data[middle:end]
        if len(data) < end or [zlib.crc32(text) for text in texts] != sums:
            return False
        self._plain, self._text = json.loads(texts[0].decode()), texts[1]
        self._start = end + -end % 8
        return True

    def _bytes(self, at: int, count: int) -> bytes:
        """So many bytes of the file, or as many as there are."""
        try:
            os.lseek(self._file, at, os.SEEK_SET)
            return os.read(self._file, count)
        except OSError:
            return b""

    def _arrays(self) -> dict[str, Value]:
        """The second index."""
        if self._index is None:
            self._index = json.loads(self._text.decode())
        return self._index

    def names(self) -> list[str]:
        """Names of all values."""
        return [*self._plain, *self._arrays()]

    def get(self, name: str) -> Value | None:
        """A value; None where there is none, or its bytes are damaged."""
        plain = self._plain.get(name)
        if plain is not None:
            return plain
        stored = self._arrays().get(name)
        if stored is None:
            return None
        found: Value = {}
        for key, item in stored.items():
            if not (isinstance(item, dict) and _ARRAY in item):
                found[key] = item
                continue
            array = self._array(*item[_ARRAY])
            if array is None:
                return None
            found[key] = array
        return found

    def _array(
        self, at: int, count: int, length: int, runs: int | None, kind: str, told: int
    ) -> NDArray[Any] | None:
        words = self._words(self._start + at, -(-count // 8))
        if words is None or _sum(words) != told:
            return None
        dtype = np.dtype(kind)
        if runs is None:
            return words.view(dtype)[:length]
        values = words[-(-runs // 2) :].view(dtype)
        if runs == 1:
            return np.full(length, values[0])
        lengths = np.empty(runs, np.int32)
        starts = words.view(np.int32)[:runs]
        np.subtract(starts[1:], starts[:-1], out=lengths[:-1])
        lengths[-1:] = length - starts[-1:]
        return values[:runs].repeat(lengths)

    def _words(self, at: int, count: int) -> NDArray[np.uint64] | None:
        """Bytes of the file, eight by eight, in memory of their own; None where there are too few."""
        if at + 8 * count <= len(self._first):
            return np.frombuffer(self._first, np.uint64, count, at).copy()
        words = np.empty(count, np.uint64)
        try:
            os.lseek(self._file, at, os.SEEK_SET)
            if hasattr(os, "readv"):
                return words if os.readv(self._file, [words.data]) == 8 * count else None
            raw = os.read(self._file, 8 * count)
        except OSError:
            return None
        return np.frombuffer(bytearray(raw), np.uint64) if len(raw) == 8 * count else None


def encode(values: Mapping[str, Value]) -> bytes:
    """The bytes of an entry."""
    plain: dict[str, Value] = {}
    index: dict[str, Value] = {}
    blocks: list[bytes] = []
    at = 0
    for name, value in values.items():
        if not any(isinstance(item, np.ndarray) for item in value.values()):
            plain[name] = value
            continue
        index[name] = {}
        for key, item in value.items():
            if not isinstance(item, np.ndarray):
                index[name][key] = item
                continue
            raw, runs = _packed(item)
            count = len(raw)
            raw += bytes(-count % 8)
            checksum = _sum(np.frombuffer(raw, np.uint64))
            index[name][key] = {_ARRAY: [at, count, len(item), runs, item.dtype.str, checksum]}
            blocks.append(raw)
            at += len(raw)
    texts = [json.dumps(part, separators=(",", ":")).encode() for part in (plain, index)]
    head = _LENGTHS.pack(MAGIC, *map(len, texts), *map(zlib.crc32, texts)) + b"".join(texts)
    return head + bytes(-len(head) % 8) + b"".join(blocks)


def _sum(words: NDArray[np.uint64]) -> int:
    """A checksum that is fast on arrays: a vector of words times fixed odd numbers, modulo 2⁶⁴."""
    return int(words @ _factors(1 << len(words).bit_length())[: len(words)])


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
