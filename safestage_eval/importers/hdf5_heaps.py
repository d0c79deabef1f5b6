"""Heaps of texts in an HDF5 file that its library would never come back from.

Texts of any length are kept in collections of objects, one after the other. The library finds each by the
size of the one before, and goes round for ever where that is zero (seen in HDF5 1.14 and 2.0).
Layout: HDF5 File Format Specification 3.0, III.E "Disk Format: Level 1E - Global Heap".
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from .importer import SourceError

MOST = 256 << 20
"""Bytes of a file that is looked through. A larger one is read as it is, under the limit of time."""

_BEGIN = b"GCOL\x01\0\0\0"
_BLOCK = 16 << 20


def check_heaps(path: Path) -> None:
    """Follow the objects of every collection, as the library does.

    Raises:
        SourceError: a collection that something in the file points to does not end.
        OSError: the file cannot be read.
    """
    with path.open("rb") as stream:
        start = stream.read(16)
        if path.stat().st_size > MOST or len(start) < 16:
            return
        offsets, lengths = (start[13], start[14]) if start[8] < 2 else (start[9], start[10])
        if offsets not in (2, 4, 8) or lengths not in (2, 4, 8):
            return  # the library refuses it
        for at in list(_places(stream, _BEGIN)):
            if _endless(stream, at, lengths) and _pointed_to(stream, at, offsets):
                raise SourceError(
                    str(path),
                    f"a damaged HDF5 file: the texts at byte {at} have one without a size.",
                    fix="download it again",
                )


def _places(stream: BinaryIO, pattern: bytes) -> Iterator[int]:
    """Position and size of some bytes in a file."""
    stream.seek(0)
    begin, kept = 0, b""
    while block := stream.read(_BLOCK):
        data = kept + block
        place = data.find(pattern)
        while place >= 0:
            yield begin + place
            place = data.find(pattern, place + 1)
        kept = data[max(0, len(data) - len(pattern) + 1) :]
        begin += len(data) - len(kept)


def _pointed_to(stream: BinaryIO, begin: int, offsets: int) -> bool:
    """True if a value can be an object's id: the address of its collection, and its number in it.

    What is written anew leaves an old collection behind, whose bytes mean nothing any more.
    """
    address = begin.to_bytes(8, "little")[:offsets]
    for at in list(_places(stream, address)):
        stream.seek(at + offsets)
        number = stream.read(4)
        if len(number) == 4 and 0 < int.from_bytes(number, "little") < 2**16:
            return True
    return False


def _endless(stream: BinaryIO, begin: int, lengths: int) -> bool:
    """True if an object of the collection leads to no later one within it."""
    header = _whole(8 + lengths)
    stream.seek(begin)
    head = stream.read(header)
    size = int.from_bytes(head[8 : 8 + lengths], "little")
    if not header < size <= MOST:
        return False  # the library refuses it
    data = stream.read(size - header)
    if len(data) < size - header:
        return False  # cut off, which the library tells
    at = 0
    while at + header <= len(data):
        index = int.from_bytes(data[at : at + 2], "little")
        object_size = int.from_bytes(data[at + 8 : at + 8 + lengths], "little")
        step = object_size if index == 0 else header + _whole(object_size)
        if not 0 < step <= len(data) - at:
            return True
        at += step
    return False


def _whole(size: int) -> int:
    """The next multiple of 8."""
    return -(-size // 8) * 8
