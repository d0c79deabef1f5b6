"""The functions of ``mcap_kernels`` by NumPy, where the compiler of kernels has not been loaded.

Loading it takes longer than reading a file in this way, and 60 MB. What the functions take and
return is told there.
"""

from __future__ import annotations

from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

CHANNEL, MESSAGE = 4, 5
PREFIX = 9
"""Bytes of a record before its content: opcode (1) and length (8)."""

HEAD = 22
"""Bytes of a message before its data: channel (2), sequence (4), log time (8), publish time (8)."""

LONGEST = 5
"""Bytes of the number that says how long a field is: up to 32 bits, seven in a byte."""

_prefix = Struct("<BQ").unpack_from
_start = Struct("<BQH").unpack_from
"""Prefix, and the channel number that messages begin with, where there are as many bytes."""

_START = 11


def find_messages(
    raw: NDArray[np.uint8], at: int, topics: Any, out: Any, counts: NDArray[np.int64]
) -> int:
    """See the kernel of this name."""
    data, size, room = raw.data, len(raw), out.shape[1]
    topic_of = topics.data
    places = [out[k, :count].tolist() for k, count in enumerate(counts.tolist())]
    while at < size:
        if size - at < PREFIX:
            return -1
        kind, length, number = _start(data, at) if size - at >= _START else (*_prefix(data, at), 0)
        begin = at + PREFIX
        end = begin + length
        if end > size:
            return -1
        if kind == CHANNEL:
            break
        if kind == MESSAGE:
            if length < 2:
                return -1
            topic = topic_of[number]
            if topic >= 0:
                if len(places[topic]) == room:
                    break
                places[topic].append((begin + HEAD if length > HEAD else end, end))
        at = end
    for k, own in enumerate(places):
        counts[k] = len(own)
        out[k, : len(own)] = np.array(own, np.int64).reshape(-1, 2)
    return at


def copy_frames(
    raw: NDArray[np.uint8], places: NDArray[np.int64], first: NDArray[np.uint8], between: Any,
    moves: NDArray[np.int64], parts: NDArray[np.int64], rows: Any, words: NDArray[np.uint32],
    numbers: Any,
    tolerance: float,
) -> int:  # fmt: skip
    """Like the kernel of this name, but returns 1 where any frame number is invalid."""
    size = len(first)
    if (places[:, 1] - places[:, 0] != size).any():
        return -1
    messages = _bytes_at(raw, places[:, 0], size)
    if (messages[:, between] != first[between]).any():
        return -1
    for offset, length, to in moves.tolist():
        rows[:, to : to + length] = messages[:, offset : offset + length]
    begin, end, turn, stop = parts.tolist()
    with np.errstate(all="ignore"):
        w, x, y, z = np.moveaxis(np.square(numbers[:, turn:stop]).reshape(-1, 4), 1, 0)
        off = np.abs(w + x + y + z - 1).max(initial=0)
        return int(
            not (np.isfinite(words[:, begin:end].view(np.float32).sum()) and off < tolerance)
        )


def find_points(
    raw: NDArray[np.uint8], places: NDArray[np.int64], fixed: Any, size: int, out: Any
) -> int:
    """See the kernel of this name."""
    at, end = places.T.copy()
    if (end - at < len(fixed) + 2).any():
        return -1
    at += 2 + raw[at + 1].astype(np.int64)
    if (at + len(fixed) >= end).any() or (_bytes_at(raw, at, len(fixed)) != fixed).any():
        return -1
    at += len(fixed)
    length = np.zeros(len(at), np.int64)
    more = np.ones(len(at), bool)
    for place in range(LONGEST):
        digit = raw[np.minimum(at, len(raw) - 1)].astype(np.int64)
        length += np.where(more, (digit & 0x7F) << 7 * place, 0)
        at += more
        more &= digit > 0x7F
    if (more | (at + length != end) | (length % size != 0)).any():
        return -1
    out[:, 0], out[:, 1] = at, end
    return int(length.sum())


def copy_points(raw: NDArray[np.uint8], places: NDArray[np.int64], rows: Any) -> None:
    """See the kernel of this name."""
    view = raw.data
    joined = b"".join([view[begin:end] for begin, end in places.tolist()])
    rows[:] = np.frombuffer(joined, np.uint8)


def _bytes_at(raw: NDArray[np.uint8], at: NDArray[np.int64], width: int) -> NDArray[np.uint8]:
    """(N, width) bytes that follow each of some positions; raises IndexError past the end."""
    # overlapping items of so many bytes, of which a few are copied
    items = np.ndarray((max(0, len(raw) - width + 1),), f"V{width}", raw.data, 0, (1,))
    return items[at].view(np.uint8).reshape(len(at), width)
