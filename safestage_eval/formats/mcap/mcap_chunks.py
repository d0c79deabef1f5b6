"""The messages inside a chunk of an MCAP file, found by walking over its records.

https://mcap.dev/spec
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.formats.checksum import crc32
from safestage_eval.size_limits import current

from .mcap_arrays import PREFIX, find_messages

_length = struct.Struct("<Q").unpack_from
_number = struct.Struct("<H").unpack_from

_MOST = 256
"""No byte of an LZ4 block stands for more."""


class Batch(NamedTuple):
    """Messages of one topic that stand in one block of bytes, in file order.

    Attributes:
        raw: (N,) uint8, the block.
        places: (M, 2) where the data of each message begins and ends in it.
    """

    raw: NDArray[np.uint8]
    places: NDArray[np.int64]

    def __len__(self) -> int:
        """M."""
        return len(self.places)

    def messages(self) -> list[bytes]:
        """Return the data of each message."""
        view = self.raw.data
        return [bytes(view[begin:end]) for begin, end in self.places.tolist()]


class Topics:
    """The numbers of the channels of some topics; a file declares them before their messages."""

    def __init__(self, names: Iterable[str]) -> None:
        self.names = tuple(names)
        self.of = np.full(1 << 16, -1, np.int16)
        """Number of a channel → place of its topic among the names; -1 for any other one."""

    def declare(self, number: int, topic: str) -> None:
        """Note the number of a channel if its topic is wanted."""
        if topic in self.names:
            self.of[number] = self.names.index(topic)


def find(block: Any, topics: Topics) -> dict[str, Batch]:
    """Return the messages of a block, by topic.

    Args:
        block: whole records, one after the other.
        topics: those to look for; channels that the block declares are added.

    Raises:
        ValueError, struct.error: the bytes are no records.
    """
    raw = np.frombuffer(block, np.uint8)
    found: list[list[tuple[int, int]]] = [[] for _ in topics.names]
    at = 0
    while (at := find_messages(raw, at, topics.of, found)) < len(raw):
        end = at + PREFIX + _length(raw.data, at + 1)[0]
        channel = raw[at + PREFIX : end].tobytes()
        topics.declare(_number(channel)[0], text(channel, 4)[0])
        at = end
    batches = zip(topics.names, found, strict=True)
    return {name: Batch(raw, np.array(places)) for name, places in batches if places}


def stated_size(content: bytes) -> int:
    """Bytes that a chunk says it holds unpacked; 0 where it is cut off."""
    return int.from_bytes(content[16:24], "little") if len(content) >= 24 else 0


def unpack(content: bytes) -> Any:
    """Return the records inside a chunk, decompressed and compared with their checksum.

    Raises:
        ValueError, RuntimeError, IndexError, struct.error: the chunk is damaged.
    """
    size, crc = struct.unpack_from("<QI", content, 16)
    if size > (most := current().allowed(len(content))):
        raise ValueError(
            f"a chunk of {size:,} bytes, of which {most:,} are allowed (--limits decoded={size})"
        )
    compression, at = text(content, 28)
    packed = memoryview(content)[at + 8 : at + 8 + _length(content, at)[0]]
    records: Any
    if compression == "lz4":
        records = _lz4(packed, size, sure=crc != 0)
    elif compression == "zstd":
        import zstandard

        try:
            stated = zstandard.frame_content_size(packed)
            if stated not in (-1, size):  # the frame's word would be taken for it
                raise ValueError(f"a chunk of {size} bytes has {stated}")
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


def _lz4(packed: memoryview, size: int, *, sure: bool) -> Any:
    """An LZ4 frame, decompressed; ``sure``: a checksum tells whether it is what it should be.

    Raises RuntimeError for what is no LZ4 frame.
    """
    import lz4.frame  # type: ignore[import-untyped]
    import pyarrow as pa

    if sure and size <= _MOST * len(packed):
        # a fifth faster, into memory that is used again; does not say how many bytes there were
        try:
            return pa.decompress(packed, size, codec="lz4")
        except (ValueError, OSError):
            pass
    frame = lz4.frame.LZ4FrameDecompressor()
    records = frame.decompress(packed, max_length=size + 1)
    if not frame.eof and len(records) <= size:
        raise RuntimeError("the LZ4 frame is cut off")
    return records


def text(data: bytes, at: int) -> tuple[str, int]:
    """Read a text with its length before it; return it and the position after it."""
    begin = at + 4
    end = begin + int.from_bytes(data[at:begin], "little")
    if end > len(data):
        raise ValueError("a text is cut off")
    return data[begin:end].decode(), end
