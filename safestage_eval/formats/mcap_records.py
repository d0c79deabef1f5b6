"""The records of an MCAP file, walked once without decoding messages one by one.

https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, field

from safestage_eval.errors import TraceError

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 1, 2, 3, 4, 5, 6
ATTACHMENT, METADATA, DATA_END = 9, 12, 15
_PREFIX = 9
"""Bytes of a record before its content: opcode (1) and length (8)."""

_length = struct.Struct("<Q").unpack_from
_start = struct.Struct("<BQH").unpack_from
"""Opcode, length, and the number that channels, schemas and messages begin with."""


@dataclass
class McapRecords:
    """What a file holds, as far as it is whole.

    Attributes:
        profile: of the header record.
        metadata: name → text by key.
        attachments: name → bytes.
        messages: topic → contents of its messages in file order, for the topics asked.
        size: bytes of the file.
        whole: False when it ends before its footer.
    """

    size: int
    profile: str = ""
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    messages: dict[str, list[memoryview]] = field(default_factory=dict)
    whole: bool = False


def walk(data: bytes, topics: tuple[str, ...], where: str) -> McapRecords:
    """Read the records of a file; of its messages those of the given topics.

    Raises:
        TraceError: not an MCAP file, or a record in it is damaged.
    """
    if not data.startswith(MAGIC):
        raise TraceError(where, "not an MCAP file: it begins with other bytes")
    found = McapRecords(len(data), messages={topic: [] for topic in topics})
    wanted: dict[int, list[memoryview]] = {}
    at = len(MAGIC)
    while at + _PREFIX <= len(data):
        kind, begin = data[at], at + _PREFIX
        end = begin + _length(data, at + 1)[0]
        if end > len(data):
            break
        try:
            if kind == CHUNK:
                _walk_messages(_chunk(data[begin:end]), wanted, found)
            elif kind in (MESSAGE, CHANNEL):
                _walk_messages(data[at:end], wanted, found)
            elif kind == HEADER:
                found.profile = _text(data, begin)[0]
            elif kind == METADATA:
                name, texts = read_metadata(data[begin:end])
                found.metadata[name] = texts
            elif kind == ATTACHMENT:
                name, content = _attachment(data[begin:end])
                found.attachments[name] = content
        except (struct.error, IndexError, ValueError, RuntimeError) as error:
            raise damaged(where, at, error) from None
        at = end
        if kind == FOOTER:
            found.whole = data[at : at + len(MAGIC)] == MAGIC
            break
    return found


def damaged(where: str, at: int, error: Exception) -> TraceError:
    """The error for a record whose bytes at a place make no sense."""
    return TraceError(
        f"{where}, byte {at}",
        f"a damaged record: {error}.",
        fix="copy the file again, or record the episode again",
    )


def _walk_messages(raw: bytes, wanted: dict[int, list[memoryview]], found: McapRecords) -> None:
    view = memoryview(raw)
    at, size = 0, len(raw)
    while at < size:
        kind, length, number = _start(raw, at)
        begin = at + _PREFIX
        at = begin + length
        if at > size:
            raise ValueError("a record is longer than its chunk")
        if kind == MESSAGE:
            if number in wanted:
                # channel (2), sequence (4), log time (8), publish time (8), then the content
                wanted[number].append(view[begin + 22 : at])
        elif kind == CHANNEL:
            topic = _text(raw, begin + 4)[0]
            if topic in found.messages:
                wanted[number] = found.messages[topic]


def _chunk(content: bytes) -> bytes:
    """The records inside a chunk, decompressed and compared with their checksum."""
    size, crc = struct.unpack_from("<QI", content, 16)
    compression, at = _text(content, 28)
    records = content[at + 8 : at + 8 + _length(content, at)[0]]
    if compression == "lz4":
        import lz4.frame  # type: ignore[import-untyped]

        records = lz4.frame.decompress(records)
    elif compression == "zstd":
        import zstandard

        try:
            records = zstandard.decompress(records, max_output_size=size)
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from None
    elif compression:
        raise ValueError(f"unknown compression {compression!r}")
    if len(records) != size:
        raise ValueError(f"a chunk of {size} bytes has {len(records)}")
    if crc and zlib.crc32(records) != crc:
        raise ValueError("a chunk does not match its checksum")
    return records


def read_metadata(content: bytes) -> tuple[str, dict[str, str]]:
    """Name and texts of a metadata record."""
    name, at = _text(content, 0)
    end = at + 4 + int.from_bytes(content[at : at + 4], "little")
    if end > len(content):
        raise ValueError("a metadata record is cut off")
    at += 4
    texts = {}
    while at < end:
        key, at = _text(content, at)
        texts[key], at = _text(content, at)
    return name, texts


def _attachment(content: bytes) -> tuple[str, bytes]:
    # log time (8), create time (8), name, media type, size (8), bytes, checksum (4)
    crc = int.from_bytes(content[-4:], "little")
    if crc and zlib.crc32(content[:-4]) != crc:
        raise ValueError("an attachment does not match its checksum")
    name, at = _text(content, 16)
    _, at = _text(content, at)
    return name, content[at + 8 : at + 8 + _length(content, at)[0]]


def _text(data: bytes, at: int) -> tuple[str, int]:
    begin = at + 4
    end = begin + int.from_bytes(data[at:begin], "little")
    if end > len(data):
        raise ValueError("a text is cut off")
    return data[begin:end].decode(), end
