"""The messages inside a chunk of an MCAP file, found without looking at them one by one.

https://mcap.dev/spec
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .checksum import crc32

CHANNEL, MESSAGE = 4, 5
PREFIX = 9
"""Bytes of a record before its content: opcode (1) and length (8)."""

HEAD = 22
"""Bytes of a message before its data: channel (2), sequence (4), log time (8), publish time (8)."""

_length = struct.Struct("<Q").unpack_from
_start = struct.Struct("<BQH").unpack_from
"""Opcode, length, and the number that channels, schemas and messages begin with."""

_START = 11
"""Bytes of a message up to the number of its channel."""


class Batch(NamedTuple):
    """Messages of one topic that stand in one block of bytes, in file order.

    Attributes:
        raw: the block.
        begin: (N,) where the data of each message begins in it.
        end: (N,) where it ends.
    """

    raw: bytes
    begin: NDArray[np.int64]
    end: NDArray[np.int64]

    def __len__(self) -> int:
        """N."""
        return len(self.begin)

    def parts(self, begin: NDArray[np.int64] | None = None) -> list[memoryview]:
        """The data of each message, or what follows another position in each, without a copy."""
        view, first = memoryview(self.raw), self.begin if begin is None else begin
        return [view[a:b] for a, b in zip(first.tolist(), self.end.tolist(), strict=True)]


class Topics:
    """The numbers of the channels of some topics; a file declares them before their messages."""

    def __init__(self, names: Iterable[str]) -> None:
        self.names = tuple(names)
        self.of: dict[int, str] = {}

    def declare(self, number: int, topic: str) -> None:
        """A channel record."""
        if topic in self.names:
            self.of[number] = topic


def find(raw: bytes, index: NDArray[np.uint64] | None, topics: Topics) -> dict[str, Batch]:
    """The messages of a block, by topic.

    Args:
        raw: whole records, one after the other.
        index: (N,) where messages begin, in any order, if the file says so. What it says is
            compared with the records; where the two differ, the records count.
        topics: those to look for; channels that the block declares are added.

    Raises:
        ValueError, IndexError, struct.error: the bytes are no records.
    """
    found = None if index is None else _indexed(raw, index, topics)
    return _walked(raw, topics) if found is None else found


def _indexed(raw: bytes, index: NDArray[np.uint64], topics: Topics) -> dict[str, Batch] | None:
    """The messages when the index names all of them; None where a walk has to tell.

    From the first message on, each must end where the next begins, and the last with the block:
    then a walk would meet the same ones.
    """
    size = len(raw)
    if not len(index) or int(index.max()) > size - _START:
        return None
    at = np.sort(index.astype(np.int64))
    first = int(at[0])
    try:
        ahead = _walked(raw[:first], topics)
    except (ValueError, IndexError, struct.error):
        return None
    if ahead:
        return None
    start = bytes_at(raw, at, _START)
    length = np.ascontiguousarray(start[:, 1:9]).view("<u8")[:, 0]
    if (start[:, 0] != MESSAGE).any() or int(length.max()) > size:
        return None
    begin = at + PREFIX
    end = begin + length.astype(np.int64)
    if end[-1] != size or (end[:-1] != at[1:]).any():
        return None
    channel = np.ascontiguousarray(start[:, 9:]).view("<u2")[:, 0]
    begin = np.minimum(begin + HEAD, end)
    found = {}
    for topic in topics.names:
        own = np.zeros(len(at), bool)
        for number, name in topics.of.items():
            if name == topic:
                own |= channel == number
        if own.any():
            found[topic] = Batch(raw, begin[own], end[own])
    return found


def bytes_at(raw: bytes, at: NDArray[np.int64], width: int) -> NDArray[np.uint8]:
    """(N, width) bytes that follow each of some positions; raises IndexError past the end."""
    # overlapping items of so many bytes, of which a few are copied
    items = np.ndarray((max(0, len(raw) - width + 1),), f"V{width}", raw, 0, (1,))
    return items[at].view(np.uint8).reshape(len(at), width)


def _walked(raw: bytes, topics: Topics) -> dict[str, Batch]:
    """The messages, record by record."""
    places: dict[str, tuple[list[int], list[int]]] = {}
    at, size = 0, len(raw)
    while at < size:
        kind, length, number = _start(raw, at)
        begin = at + PREFIX
        at = begin + length
        if at > size:
            raise ValueError("a record is longer than its chunk")
        if kind == MESSAGE:
            topic = topics.of.get(number)
            if topic is not None:
                begins, ends = places.setdefault(topic, ([], []))
                begins.append(min(begin + HEAD, at))
                ends.append(at)
        elif kind == CHANNEL:
            topics.declare(number, text(raw, begin + 4)[0])
    return {
        topic: Batch(raw, np.array(begins, np.int64), np.array(ends, np.int64))
        for topic, (begins, ends) in places.items()
    }


def unpack(content: bytes) -> bytes:
    """The records inside a chunk, decompressed and compared with their checksum.

    Raises:
        ValueError, RuntimeError, IndexError, struct.error: the chunk is damaged.
    """
    size, crc = struct.unpack_from("<QI", content, 16)
    compression, at = text(content, 28)
    packed = memoryview(content)[at + 8 : at + 8 + _length(content, at)[0]]
    if compression == "lz4":
        import lz4.frame  # type: ignore[import-untyped]

        records: bytes = lz4.frame.decompress(packed)
    elif compression == "zstd":
        import zstandard

        try:
            records = zstandard.decompress(packed, max_output_size=size)
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from None
    elif compression:
        raise ValueError(f"unknown compression {compression!r}")
    else:
        records = bytes(packed)
    if len(records) != size:
        raise ValueError(f"a chunk of {size} bytes has {len(records)}")
    if crc and crc32(records) != crc:
        raise ValueError("a chunk does not match its checksum")
    return records


def index_places(content: bytes) -> NDArray[np.uint64]:
    """(N,) where the messages of one channel begin in their chunk, by a message index record.

    Raises:
        ValueError, struct.error: the record is damaged.
    """
    # channel (2), size of the array (4), then log time (8) and offset (8) of each message
    (size,) = struct.unpack_from("<I", content, 2)
    entries = np.frombuffer(memoryview(content)[6 : 6 + size], "<u8")
    return entries.reshape(-1, 2)[:, 1]


def text(data: bytes, at: int) -> tuple[str, int]:
    """A text with its length before it, and the position after it."""
    begin = at + 4
    end = begin + int.from_bytes(data[at:begin], "little")
    if end > len(data):
        raise ValueError("a text is cut off")
    return data[begin:end].decode(), end
