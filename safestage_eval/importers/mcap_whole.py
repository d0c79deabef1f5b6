"""Check that a foreign MCAP file is complete, before its reader trusts it.

The library asks no checksum of the summary, gives an LZ4 chunk all the memory that it unpacks to, and yields fewer
messages where the index of chunks lost one. Layout: mcap.dev/spec.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any, BinaryIO
from zlib import crc32

from safestage_eval.formats.mcap.mcap_records import unpack

MAGIC = 8
CHUNK = 6
FOOTER = 9 + 20
"""Bytes of the last record, before the magic."""


def whole_messages(stream: BinaryIO) -> Iterator[tuple[Any, Any, Any]]:
    """Yield (schema, channel, message) of an open file, by their times.

    Raises:
        ValueError: something is damaged, a chunk unpacks to more than it says, or messages are missing.
    """
    from mcap.reader import McapReader, NonSeekingReader, make_reader

    reader: McapReader = make_reader(stream)
    check_summary(stream)
    summary = reader.get_summary()
    if summary is not None and summary.chunk_indexes:
        for index in summary.chunk_indexes:
            _check_chunk(stream, index.chunk_start_offset)
    else:
        for at in _chunks(stream):
            _check_chunk(stream, at)
        stream.seek(0)
        reader = NonSeekingReader(stream, validate_crcs=True)
    count = 0
    for message in reader.iter_messages():
        count += 1
        yield message
    statistics = None if summary is None else summary.statistics
    if statistics is not None and statistics.message_count != count:
        raise ValueError(
            f"it says that it has {statistics.message_count:,} messages, and has {count:,}"
        )


def check_summary(stream: BinaryIO) -> None:
    """Compare the summary with its checksum. Raises ValueError; it may hold no chunk, which would be unpacked."""
    size = stream.seek(0, 2)
    stream.seek(max(0, size - MAGIC - FOOTER))
    footer = stream.read(FOOTER)
    if len(footer) < FOOTER:
        raise ValueError("it is cut off")
    begin, _, crc = struct.unpack_from("<QQI", footer, 9)
    if not begin:
        return
    if begin > size - MAGIC - FOOTER:
        raise ValueError("its summary begins behind the end")
    if next(_chunks(stream, begin), None) is not None:
        raise ValueError("there is a chunk in its summary")
    stream.seek(begin)
    if crc and crc32(stream.read(size - MAGIC - 4 - begin)) != crc:
        raise ValueError("its summary does not match its checksum")


def _chunks(stream: BinaryIO, at: int = MAGIC) -> Iterator[int]:
    """Yield the positions of the chunks from a byte on, one record after the other."""
    size = stream.seek(0, 2)
    while at + 9 <= size:
        stream.seek(at)
        kind, length = struct.unpack("<BQ", stream.read(9))
        if kind == CHUNK:
            yield at
        at += 9 + length


def _check_chunk(stream: BinaryIO, at: int) -> None:
    """Unpack it within the limits of our own files, and compare its checksum."""
    size = stream.seek(0, 2)
    if at + 9 > size:
        raise ValueError("its index points behind its end")
    stream.seek(at)
    kind, length = struct.unpack("<BQ", stream.read(9))
    if kind != CHUNK or length > size - at - 9:
        raise ValueError(f"there is no whole chunk at byte {at}")
    try:
        unpack(stream.read(length))
    except (RuntimeError, IndexError, struct.error) as error:
        raise ValueError(f"the chunk at byte {at}: {error}") from None
