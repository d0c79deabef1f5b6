"""The records of an MCAP file, read once from beginning to end, chunk by chunk.

Every function checks a stated length against the bytes that are there before it uses it.

https://mcap.dev/spec
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import TraceError
from safestage_eval.formats.checksum import crc32
from safestage_eval.size_limits import current

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, CHANNEL, MESSAGE, CHUNK, ATTACHMENT, METADATA = 1, 2, 4, 5, 6, 9, 12

DAMAGE = (struct.error, IndexError, ValueError, RuntimeError)
"""What reading damaged records raises."""

_READ = (HEADER, FOOTER, CHANNEL, MESSAGE, CHUNK, ATTACHMENT, METADATA)

_PREFIX = 9
"""Bytes of a record before its content: opcode (1) and length (8)."""

_HEAD = 22
"""Bytes of a message before its data: channel (2), sequence (4), log time (8), publish time (8)."""

_MOST = 256
"""No byte of an LZ4 block stands for more."""

_prefix = struct.Struct("<BQ").unpack_from
_start = struct.Struct("<BQH").unpack_from
"""Prefix, and the channel number that messages begin with: every record in a chunk has as many bytes."""
_length = struct.Struct("<Q").unpack_from


class Batch(NamedTuple):
    """Messages of one topic that stand in one block of bytes, in file order.

    Attributes:
        raw: (N,) uint8, the block.
        places: (M, 2) where the data of each message begins and ends in it.
    """

    raw: NDArray[np.uint8]
    places: NDArray[np.int64]

    def messages(self) -> list[bytes]:
        """Return the data of each message."""
        view = self.raw.data
        return [bytes(view[begin:end]) for begin, end in self.places.tolist()]

    def bytes_at(self, at: NDArray[np.int64], width: int) -> NDArray[np.uint8]:
        """Return the (K, width) bytes behind some places of the block; raises IndexError past its end."""
        # overlapping items of so many bytes, of which a few are copied
        items = np.ndarray(
            (max(0, len(self.raw) - width + 1),), f"V{width}", self.raw.data, 0, (1,)
        )
        return items[at].view(np.uint8).reshape(len(at), width)


@dataclass
class McapRecords:
    """The contents of a file, as far as it is whole.

    Attributes:
        size: bytes of the file.
        profile: of the header record.
        metadata: name → text by key.
        attachments: name → bytes.
        messages: topic → its messages, of those that are wanted.
        whole: False when it ends before its footer, or before what it was read until.
    """

    size: int
    profile: str = ""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    messages: dict[str, list[Batch]] = field(default_factory=dict)
    whole: bool = False

    def count(self, topic: str) -> int:
        """How many messages there are on a topic."""
        return sum(len(batch.places) for batch in self.messages[topic])


def read_records(path: Path, topics: tuple[str, ...], *, until: str = "") -> McapRecords:
    """Read the records of a file, and the messages on some topics.

    Args:
        path: the file.
        topics: of the messages that are wanted.
        until: name of a metadata record at which to stop; at the first chunk in any case, then.

    Raises:
        TraceError: not an MCAP file, it cannot be read, or a record in it is damaged.
    """
    where, at, decoded = str(path), 0, 0
    try:
        with path.open("rb") as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise _no_mcap(path, where)
            records = McapRecords(path.stat().st_size)
            messages = _Messages(topics, records)
            for at, kind, content in _contents(stream, records):  # noqa: B007 - the last is told
                if kind == CHUNK:
                    if until:
                        records.whole = True
                        break
                    decoded += stated_size(content)
                    current().demand_decoded(decoded, records.size, where)
                messages.take(kind, content)
                if until in records.metadata:
                    break
            messages.take_loose()
    except DAMAGE as error:
        raise TraceError(
            f"{where}, byte {at}",
            f"a damaged record: {error}.",
            fix="copy the file again, or record the episode again",
        ) from None
    except OSError as error:
        raise TraceError(where, f"cannot be read: {error.strerror}") from None
    return records


def _no_mcap(path: Path, where: str) -> TraceError:
    if not path.stat().st_size:
        return TraceError(
            where, "the file is empty.", fix="copy the file again, or record the episode again"
        )
    return TraceError(
        where,
        "not an MCAP file: it begins with other bytes.",
        "a trace in MCAP, or the folder of a Parquet dataset",
        "name another file, copy it again, or convert recordings of others with safestage import",
    )


def _contents(stream: BinaryIO, records: McapRecords) -> Iterator[tuple[int, int, bytes]]:
    """Place, opcode and content of each record that matters here, as far as they are whole."""
    at = len(MAGIC)
    while len(prefix := stream.read(_PREFIX)) == _PREFIX:
        kind, size = _prefix(prefix)
        end = at + _PREFIX + size
        if end > records.size:
            return
        if kind in _READ:
            content = stream.read(size)
            if len(content) != size:
                return
            yield at, kind, content
        else:
            stream.seek(end)
        at = end
        if kind == FOOTER:
            records.whole = stream.read(len(MAGIC)) == MAGIC
            return


class _Messages:
    """Adds to records what those of a file say, one after the other."""

    def __init__(self, topics: tuple[str, ...], records: McapRecords) -> None:
        self._records = records
        records.messages = {topic: [] for topic in topics}
        self._topic_of: dict[int, str] = {}
        """Number of a channel → its topic, of those that are wanted."""
        self._loose = bytearray()
        """Messages outside of chunks, as whole records."""

    def take(self, kind: int, content: bytes) -> None:
        """Keep what a record says; of a chunk, the messages in it. Raises ``DAMAGE``."""
        records = self._records
        if kind == MESSAGE:
            self._loose += struct.pack("<BQ", kind, len(content)) + content
        elif kind == CHUNK:
            self.take_loose()
            self._take_block(unpack(content))
        elif kind == CHANNEL:
            self._declare(content)
        elif kind == HEADER:
            records.profile = text(content, 0)[0]
        elif kind == METADATA:
            name, texts = _metadata(content)
            records.metadata[name] = texts
        elif kind == ATTACHMENT:
            name, data = _attachment(content)
            records.attachments[name] = data

    def take_loose(self) -> None:
        """Keep the messages that came outside of chunks since the last one."""
        if self._loose:
            self._take_block(bytes(self._loose))
            self._loose.clear()

    def _declare(self, channel: bytes) -> None:
        topic = text(channel, 4)[0]
        if topic in self._records.messages:
            self._topic_of[int.from_bytes(channel[:2], "little")] = topic

    def _take_block(self, block: Any) -> None:
        """Keep the messages of a block of whole records."""
        raw = np.frombuffer(block, np.uint8)
        data, size, at = raw.data, len(raw), 0
        found: dict[str, list[tuple[int, int]]] = {topic: [] for topic in self._records.messages}
        wanted = {number: found[topic] for number, topic in self._topic_of.items()}
        while at < size:
            kind, length, number = _start(data, at)
            begin = at + _PREFIX
            at = begin + length
            if at > size:
                raise ValueError("a record is longer than its chunk, or cut off")
            if kind == MESSAGE:
                if length < _HEAD:
                    raise ValueError("a message is cut off")
                if number in wanted:
                    wanted[number].append((begin + _HEAD, at))
            elif kind == CHANNEL:
                self._declare(bytes(data[begin:at]))
                wanted = {number: found[topic] for number, topic in self._topic_of.items()}
        for topic, places in found.items():
            if places:
                self._records.messages[topic].append(Batch(raw, np.array(places)))


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
        records = _zstd(packed, size)
    elif compression:
        raise ValueError(f"unknown compression {compression!r}")
    else:
        records = bytes(packed)
    if len(records) != size:
        raise ValueError(f"a chunk of {size} bytes has {len(records)}")
    if crc and crc32(records) != crc:
        raise ValueError("a chunk does not match its checksum")
    return records


def _zstd(packed: memoryview, size: int) -> bytes:
    import zstandard

    try:
        stated = zstandard.frame_content_size(packed)
        if stated not in (-1, size):  # the frame's word would be taken for it
            raise ValueError(f"a chunk of {size} bytes has {stated}")
        return zstandard.decompress(packed, max_output_size=size)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from None


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
    """A text with its length before it, and the position after it."""
    begin = at + 4
    end = begin + int.from_bytes(data[at:begin], "little")
    if end > len(data):
        raise ValueError("a text is cut off")
    return data[begin:end].decode(), end


def _metadata(content: bytes) -> tuple[str, dict[str, str]]:
    """Name and texts of a metadata record."""
    name, at = text(content, 0)
    end = at + 4 + int.from_bytes(content[at : at + 4], "little")
    if end > len(content):
        raise ValueError("a metadata record is cut off")
    at += 4
    texts = {}
    while at < end:
        key, at = text(content, at)
        texts[key], at = text(content, at)
    return name, texts


def _attachment(content: bytes) -> tuple[str, bytes]:
    # log time (8), create time (8), name, media type, size (8), bytes, checksum (4)
    crc = int.from_bytes(content[-4:], "little")
    if crc and crc32(content[:-4]) != crc:
        raise ValueError("an attachment does not match its checksum")
    name, at = text(content, 16)
    _, at = text(content, at)
    (size,) = _length(content, at)
    return name, content[at + 8 : at + 8 + size]
