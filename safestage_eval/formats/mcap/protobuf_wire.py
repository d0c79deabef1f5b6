"""The few bytes of protobuf's wire format that are written and read in bulk here.

https://protobuf.dev/programming-guides/encoding/
"""

from __future__ import annotations

from google.protobuf.timestamp_pb2 import Timestamp

VARINT, FIXED64, LENGTH, FIXED32 = 0, 1, 2, 5


def varint(n: int) -> bytes:
    """A non-negative integer, seven bits per byte, least significant first."""
    out = bytearray()
    while n > 0x7F:
        out.append(n & 0x7F | 0x80)
        n >>= 7
    out.append(n)
    return bytes(out)


def tag(number: int, kind: int) -> bytes:
    """What stands before a field's value."""
    return varint(number << 3 | kind)


def field(number: int, data: bytes) -> bytes:
    """A field of bytes: text, a message, or packed numbers."""
    return tag(number, LENGTH) + varint(len(data)) + data


def stamp(number: int, nanoseconds: int) -> bytes:
    """A field that is a ``google.protobuf.Timestamp``."""
    time = Timestamp(seconds=nanoseconds // 10**9, nanos=nanoseconds % 10**9)
    return field(number, time.SerializeToString())


def read_varint(data: bytes | memoryview, at: int) -> tuple[int, int]:
    """The integer at a position and the position after it; IndexError past the end or 64 bits."""
    n, shift = 0, 0
    while True:
        if shift > 63:
            raise IndexError("an integer of more than 64 bits")
        byte = data[at]
        at += 1
        n |= (byte & 0x7F) << shift
        if byte < 0x80:
            return n, at
        shift += 7


def layout(message: bytes) -> dict[int, tuple[int, int]]:
    """Field number → (offset, bytes) of its value in a message of fixed-width and packed fields.

    Raises:
        ValueError: another kind of field, one that comes twice, or a message that is cut off.
    """
    found: dict[int, tuple[int, int]] = {}
    at = 0
    try:
        while at < len(message):
            key, at = read_varint(message, at)
            if key & 7 == LENGTH:
                size, at = read_varint(message, at)
            elif key & 7 in (FIXED64, FIXED32):
                size = 8 if key & 7 == FIXED64 else 4
            else:
                raise ValueError(f"field {key >> 3} has wire type {key & 7}")
            if key >> 3 in found:
                raise ValueError(f"field {key >> 3} comes twice")
            found[key >> 3] = at, size
            at += size
    except IndexError:
        raise ValueError("the message is cut off") from None
    if at != len(message):
        raise ValueError("the message is cut off")
    return found
