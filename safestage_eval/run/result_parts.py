"""Finished results in a folder, many to a file: written whole, found again by their keys.

A part is a line of JSON that says which results are in it, then these as JSON lines, compressed. It
is named after their keys, so two runs that write the same part write the same name; a part that is
cut off or damaged is as good as none, and its episodes are judged again.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import time
import zlib
from array import array
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import zstandard

from safestage_eval.errors import InputError
from safestage_eval.formats.atomic import write_bytes

FORMAT = 1
ENDING = ".results"
_OPEN = 8
"""Parts whose content is kept in memory."""
_SUM = 8
"""Characters of the checksum that a part begins with."""
_LARGEST = 1 << 30
"""Bytes that a part may unfold to."""


class Line(NamedTuple):
    """A result as it is stored, and by what it is known again."""

    text: bytes
    episode_id: str
    trace_hash: str


class Entry(NamedTuple):
    """Entry for a result in the head of a part."""

    key: str
    size: int
    episode: int
    trace: int


class Parts:
    """The parts in a folder, and those that are added. Of each result a few numbers are held."""

    def __init__(self, folder: Path) -> None:
        """Looks at what is there already. Raises InputError when the folder cannot be used."""
        self.folder = folder
        self._files: list[str] = []
        self._file, self._line = array("i"), array("i")
        self._episode, self._trace = array("Q"), array("Q")
        self._rows: dict[bytes, int] = {}
        self._content = lru_cache(maxsize=_OPEN)(self._read)
        try:
            folder.mkdir(parents=True, exist_ok=True)
            names = sorted(path.name for path in folder.iterdir())
        except OSError as error:
            raise InputError(str(folder), f"cannot be used: {error.strerror}.") from None
        for name in names:
            if name.endswith(ENDING):
                self.adopt(name)
            elif name.endswith(".part"):  # left by a process that was killed
                with contextlib.suppress(OSError):
                    if time.time() - (folder / name).stat().st_mtime > 3600:
                        (folder / name).unlink()

    def adopt(self, name: str) -> list[int]:
        """The numbers of the results in a part, which need not be known yet; none if it is damaged."""
        entries = _head(self.folder / name)
        file = len(self._files)
        self._files.append(name)
        rows = []
        for line, entry in enumerate(entries):
            rows.append(len(self._file))
            self._rows[bytes.fromhex(entry.key)] = len(self._file)
            self._file.append(file)
            self._line.append(line)
            self._episode.append(entry.episode)
            self._trace.append(entry.trace)
        return rows

    def find(self, key: str) -> int | None:
        """The number of the result with a key, if it can be read; None where there is none."""
        row = self._rows.get(bytes.fromhex(key))
        if row is None or self._content(self._file[row]) is None:
            return None
        return row

    def add(self, results: Sequence[tuple[str, Line]]) -> list[int]:
        """Write results by key as a part; their numbers. Raises InputError when it cannot be done."""
        return self.adopt(write(self.folder, results))

    def line(self, row: int) -> bytes:
        """A result as it was stored. Raises InputError when it was damaged or removed meanwhile."""
        lines = self._content(self._file[row])
        if lines is None:
            where = self.folder / self._files[self._file[row]]
            raise InputError(
                str(where), "was damaged or removed while the run went on.", fix="run it again"
            )
        return lines[self._line[row]]

    def episode(self, row: int) -> int:
        """A number that stands for the id of the episode."""
        return self._episode[row]

    def trace(self, row: int) -> int:
        """A number that stands for the content of the trace."""
        return self._trace[row]

    def _read(self, file: int) -> list[bytes] | None:
        path = self.folder / self._files[file]
        entries = _head(path)
        try:
            with path.open("rb") as stream:
                stream.readline()
                packed = stream.read()
            size = zstandard.frame_content_size(packed)
            if not entries or size > _LARGEST:
                return None
            text = zstandard.ZstdDecompressor().decompress(packed)
        except (OSError, zstandard.ZstdError):
            return None
        lines, at = [], 0
        for entry in entries:
            lines.append(text[at : at + entry.size])
            at += entry.size
        return lines if at == len(text) else None


def write(folder: Path, results: Sequence[tuple[str, Line]]) -> str:
    """Write results by key as a part; its name. Raises InputError when it cannot be done."""
    entries = [
        [key, len(line.text), short(line.episode_id), short(line.trace_hash)]
        for key, line in results
    ]
    head = json.dumps({"format": FORMAT, "results": entries}, separators=(",", ":")).encode()
    name = hashlib.sha256("".join(key for key, _ in results).encode()).hexdigest()[:32] + ENDING
    compressor = zstandard.ZstdCompressor(level=1, write_checksum=True, write_content_size=True)
    body = compressor.compress(b"".join(line.text for _, line in results))
    try:
        write_bytes(folder / name, f"{zlib.crc32(head):08x}".encode() + head + b"\n" + body)
    except OSError as error:
        raise InputError(
            str(folder), f"results cannot be written there: {error.strerror}.",
            fix="make room, or another --resume folder; what is written is kept",
        ) from None  # fmt: skip
    return name


def short(text: str) -> int:
    """A number of 64 bits that stands for a text."""
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def _head(path: Path) -> list[Entry]:
    try:
        with path.open("rb") as stream:
            line = stream.readline()
    except OSError:
        return []
    text = line[_SUM:].rstrip(b"\n")
    if not line.endswith(b"\n") or line[:_SUM] != f"{zlib.crc32(text):08x}".encode():
        return []
    head = json.loads(text)
    return [Entry(*entry) for entry in head["results"]] if head.get("format") == FORMAT else []
