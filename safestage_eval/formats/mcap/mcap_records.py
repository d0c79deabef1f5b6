"""The records of an MCAP file, read once from beginning to end, chunk by chunk.

https://mcap.dev/spec
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from safestage_eval.errors import TraceError
from safestage_eval.formats.checksum import crc32
from safestage_eval.size_limits import current

from .mcap_arrays import CHANNEL, MESSAGE, PREFIX, Batch, find_messages

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, CHUNK, ATTACHMENT, METADATA = 1, 2, 6, 9, 12

_READ = (HEADER, FOOTER, CHANNEL, MESSAGE, CHUNK, ATTACHMENT, METADATA)
_RUN = 1 << 20
"""Bytes of messages outside of chunks that are handed on together."""

_length = struct.Struct("<Q").unpack_from
_number = struct.Struct("<H").unpack_from

_MOST = 256
"""No byte of an LZ4 block stands for more."""

_DAMAGE = (struct.error, IndexError, ValueError, RuntimeError)

Sink = Callable[[Batch], None]
"""Takes messages of a topic, some at a time; keeps no more of them than it copies."""


@dataclass
class McapRecords:
    """The contents of a file besides messages, as far as it is whole.

    Attributes:
        size: bytes of the file.
        profile: of the header record.
        metadata: name → text by key.
        attachments: name → bytes.
        decoded: bytes of chunks so far, unpacked.
        whole: False when it ends before its footer.
    """

    size: int
    profile: str = ""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    whole: bool = False
    decoded: int = 0


def no_mcap(path: Path, where: str) -> TraceError:
    """The error about a file that does not begin as one in MCAP does."""
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


def walk(path: Path, sinks: Mapping[str, Sink], where: str) -> McapRecords:
    """Read the records of a file and hand its messages to the sink of their topic, in file order.

    Raises:
        TraceError: not an MCAP file, it cannot be read, or a record in it is damaged.
    """
    try:
        with path.open("rb") as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                raise no_mcap(path, where)
            records = McapRecords(path.stat().st_size)
            messages = _Messages(sinks)
            for at, kind, content in _contents(stream, records):
                if kind == CHUNK:
                    records.decoded += stated_size(content)
                    current().demand_decoded(records.decoded, records.size, where)
                try:
                    messages.take(kind, content, records)
                except _DAMAGE as error:
                    raise damaged(where, at, error) from None
            try:
                messages.hand_on()
            except _DAMAGE as error:
                raise damaged(where, records.size, error) from None
    except OSError as error:
        raise TraceError(where, f"cannot be read: {error.strerror}") from None
    return records


def _contents(stream: BinaryIO, records: McapRecords) -> Iterator[tuple[int, int, bytes]]:
    """Place, opcode and content of each record that matters here, as far as they are whole."""
    at = len(MAGIC)
    while len(prefix := stream.read(PREFIX)) == PREFIX:
        kind, size = prefix[0], int.from_bytes(prefix[1:], "little")
        end = at + PREFIX + size
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
    """Hands the messages of some topics to the sink of each: those of a chunk at once, others some at a time."""

    def __init__(self, sinks: Mapping[str, Sink]) -> None:
        self._sinks = sinks
        self._names = list(sinks)
        self._topic_of = np.full(1 << 16, -1, np.int16)
        """Number of a channel → place of its topic among the names; -1 for any other one."""
        self._single = bytearray()

    def take(self, kind: int, content: bytes, records: McapRecords) -> None:
        """Keep what a record says; of a chunk, the messages in it. Raises ``_DAMAGE``."""
        if kind == MESSAGE:  # outside of a chunk
            self._single += bytes([MESSAGE]) + len(content).to_bytes(8, "little") + content
            if len(self._single) > _RUN:
                self.hand_on()
            return
        self.hand_on()
        if kind == CHUNK:
            self._give(unpack(content))
        elif kind == CHANNEL:
            self._declare(content)
        elif kind == HEADER:
            records.profile = text(content, 0)[0]
        elif kind == METADATA:
            name, texts = read_metadata(content)
            records.metadata[name] = texts
        elif kind == ATTACHMENT:
            name, data = _attachment(content)
            records.attachments[name] = data

    def hand_on(self) -> None:
        """Hand the single messages that wait to the sinks."""
        waiting, self._single = bytes(self._single), bytearray()
        self._give(waiting)

    def _declare(self, channel: bytes) -> None:
        """Note the number of a channel if its topic is wanted."""
        topic = text(channel, 4)[0]
        if topic in self._names:
            self._topic_of[_number(channel)[0]] = self._names.index(topic)

    def _give(self, block: Any) -> None:
        """Hand the messages of a block of whole records to the sinks."""
        raw = np.frombuffer(block, np.uint8)
        found: list[list[tuple[int, int]]] = [[] for _ in self._names]
        at = 0
        while (at := find_messages(raw, at, self._topic_of, found)) < len(raw):
            end = at + PREFIX + _length(raw.data, at + 1)[0]
            self._declare(raw[at + PREFIX : end].tobytes())
            at = end
        for name, places in zip(self._names, found, strict=True):
            if places:
                self._sinks[name](Batch(raw, np.array(places)))


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


def damaged(where: str, at: int, error: Exception) -> TraceError:
    """Return the error for a damaged record at a byte."""
    return TraceError(
        f"{where}, byte {at}",
        f"a damaged record: {error}.",
        fix="copy the file again, or record the episode again",
    )


def read_metadata(content: bytes) -> tuple[str, dict[str, str]]:
    """Return the name and texts of a metadata record."""
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
    (size,) = struct.unpack_from("<Q", content, at)
    return name, content[at + 8 : at + 8 + size]
