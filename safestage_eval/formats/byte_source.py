"""Bytes of an object in a store that are read by ranges."""

from __future__ import annotations

import io
import os
from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any

BLOCK = 1 << 18
"""Bytes that are asked of a store at least: a request costs as much time as a megabyte or so."""

KEPT = 64
"""Blocks of an object that are kept."""


class Source(ABC):
    """An open file or object.

    Attributes:
        size: in bytes.
        state: of the content; a file that is written anew has another.
    """

    size: int
    state: Hashable

    @abstractmethod
    def read(self, at: int, count: int) -> bytes:
        """So many bytes from a place on, or as many as there are. Raises OSError."""


class BlockSource(Source):
    """An object of which whole blocks are fetched: those of a range in one request, each once."""

    def __init__(
        self, size: int, fetch: Callable[[int, int], bytes], state: Hashable = None
    ) -> None:
        """``fetch``: bytes from a place on, exactly as many as asked for; raises OSError."""
        self.size, self.state, self._fetch = size, state, fetch
        self._blocks: OrderedDict[int, bytes] = OrderedDict()

    def read(self, at: int, count: int) -> bytes:
        """See ``Source.read``."""
        end = min(at + count, self.size)
        if end <= at:
            return b""
        first, last = at // BLOCK, (end - 1) // BLOCK
        if last - first >= KEPT:
            return self._fetch(at, end - at)
        blocks: dict[int, bytes] = {}
        block = first
        while block <= last:
            if block in self._blocks:
                self._blocks.move_to_end(block)
                blocks[block] = self._blocks[block]
                block += 1
                continue
            stop = block
            while stop <= last and stop not in self._blocks:
                stop += 1
            begin = block * BLOCK
            data = self._fetch(begin, min(stop * BLOCK, self.size) - begin)
            for number in range(block, stop):
                part = data[(number - block) * BLOCK : (number - block + 1) * BLOCK]
                blocks[number] = self._blocks[number] = part
            block = stop
        while len(self._blocks) > KEPT:
            self._blocks.popitem(last=False)
        joined = b"".join(blocks[number] for number in range(first, last + 1))
        return joined[at - first * BLOCK : end - first * BLOCK]


class SourceStream(io.RawIOBase):
    """A source as a file object."""

    def __init__(self, source: Source) -> None:
        super().__init__()
        self._source, self._at = source, 0

    def readable(self) -> bool:
        """Yes."""
        return True

    def seekable(self) -> bool:
        """Yes."""
        return True

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """The new place."""
        base = {os.SEEK_SET: 0, os.SEEK_CUR: self._at, os.SEEK_END: self._source.size}[whence]
        self._at = max(0, base + offset)
        return self._at

    def tell(self) -> int:
        """The place."""
        return self._at

    def readinto(self, buffer: Any) -> int:
        """How many bytes were read."""
        data = self._source.read(self._at, len(buffer))
        buffer[: len(data)] = data
        self._at += len(data)
        return len(data)
