"""The records of an MCAP file, read once from beginning to end, chunk by chunk.

https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from safestage_eval.errors import TraceError
from safestage_eval.size_limits import current

from .mcap_arrays import CHANNEL, MESSAGE, PREFIX
from .mcap_chunks import Batch, Topics, find, stated_size, text, unpack

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, CHUNK, ATTACHMENT, METADATA = 1, 2, 6, 9, 12

_READ = (HEADER, FOOTER, CHANNEL, MESSAGE, CHUNK, ATTACHMENT, METADATA)
_RUN = 1 << 20
"""Bytes of messages outside of chunks that are handed on together."""

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
                if kind != MESSAGE:
                    messages.hand_on()
                try:
                    batches = _take(kind, content, messages, records)
                except _DAMAGE as error:
                    raise damaged(where, at, error) from None
                messages.give(batches)
            messages.hand_on()
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


def _take(
    kind: int, content: bytes, messages: _Messages, records: McapRecords
) -> Mapping[str, Batch]:
    """Keep what a record says; of a chunk, the messages in it."""
    if kind == CHUNK:
        return find(unpack(content), messages.topics)
    if kind == MESSAGE:
        messages.single(content)
    elif kind == CHANNEL:
        (number,) = struct.unpack_from("<H", content)
        messages.topics.declare(number, text(content, 4)[0])
    elif kind == HEADER:
        records.profile = text(content, 0)[0]
    elif kind == METADATA:
        name, texts = read_metadata(content)
        records.metadata[name] = texts
    elif kind == ATTACHMENT:
        name, data = _attachment(content)
        records.attachments[name] = data
    return {}


class _Messages:
    """Hands messages on to the sinks: those of a chunk at once, others some at a time."""

    def __init__(self, sinks: Mapping[str, Sink]) -> None:
        self.topics = Topics(sinks)
        self._sinks = sinks
        self._single = bytearray()

    def give(self, batches: Mapping[str, Batch]) -> None:
        """Hand each topic's messages to its sink."""
        for topic, batch in batches.items():
            self._sinks[topic](batch)

    def single(self, content: bytes) -> None:
        """Keep a message that stands outside of chunks."""
        if len(content) < 2:
            raise ValueError("a message without a channel")
        if len(self._single) > _RUN:
            self.hand_on()
        self._single += bytes([MESSAGE]) + len(content).to_bytes(8, "little") + content

    def hand_on(self) -> None:
        """Hand the single messages that wait to the sinks."""
        if self._single:
            waiting, self._single = bytes(self._single), bytearray()
            self.give(find(waiting, self.topics))


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
    if crc and zlib.crc32(content[:-4]) != crc:
        raise ValueError("an attachment does not match its checksum")
    name, at = text(content, 16)
    _, at = text(content, at)
    (size,) = struct.unpack_from("<Q", content, at)
    return name, content[at + 8 : at + 8 + size]
