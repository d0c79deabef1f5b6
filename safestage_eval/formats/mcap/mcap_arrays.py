"""The messages of a chunk: found, compared with the layout they should have, and copied.

Every function checks a stated length against the bytes that are there before it uses it.
"""

from __future__ import annotations

from struct import Struct
from typing import NamedTuple

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

_CUT_OFF = "a record is longer than its chunk, or cut off"


class Batch(NamedTuple):
    """Messages of one topic that stand in one block of bytes, in file order.

    Attributes:
        raw: (N,) uint8, the block.
        places: (M, 2) where the data of each message begins and ends in it.
    """

    raw: NDArray[np.uint8]
    places: NDArray[np.int64]

    def __len__(self) -> int:
        """M."""
        return len(self.places)

    def messages(self) -> list[bytes]:
        """Return the data of each message."""
        view = self.raw.data
        return [bytes(view[begin:end]) for begin, end in self.places.tolist()]


def find_messages(
    raw: NDArray[np.uint8], at: int, topics: NDArray[np.int16], found: list[list[tuple[int, int]]]
) -> int:
    """Find the messages of a block of records, up to the next one that declares a channel.

    Args:
        raw: (N,) uint8, whole records one after the other.
        at: where to begin.
        topics: (65536,) number of the topic of a channel; -1 for those that nobody wants.
        found: of each topic, where the data of its messages begin and end; goes on from there.

    Returns:
        Where the next channel record begins, or the length of the block at its end.

    Raises:
        ValueError: the bytes are no records.
    """
    data, size, topic_of = raw.data, len(raw), topics.data
    while at < size:
        if size - at < PREFIX:
            raise ValueError(_CUT_OFF)
        kind, length, number = _start(data, at) if size - at >= _START else (*_prefix(data, at), 0)
        begin = at + PREFIX
        end = begin + length
        if end > size:
            raise ValueError(_CUT_OFF)
        if kind == CHANNEL:
            break
        if kind == MESSAGE:
            if length < 2:
                raise ValueError(_CUT_OFF)
            topic = topic_of[number]
            if topic >= 0:
                found[topic].append((begin + HEAD if length > HEAD else end, end))
        at = end
    return at


def alike(batch: Batch, between: NDArray[np.intp]) -> NDArray[np.uint8] | None:
    """Return messages (M, S) that are laid out like the first one, side by side.

    Args:
        batch: the messages.
        between: (K,) which of the first one's bytes are no values: all messages must share them.

    Returns:
        None where a message is laid out in another way.
    """
    begin, end = batch.places[0].tolist()
    if (batch.places[:, 1] - batch.places[:, 0] != end - begin).any():
        return None
    messages = _bytes_at(batch.raw, batch.places[:, 0], end - begin)
    return None if (messages[:, between] != messages[0, between]).any() else messages


def find_points(
    raw: NDArray[np.uint8], places: NDArray[np.int64], fixed: NDArray[np.uint8], size: int
) -> NDArray[np.int64] | None:
    """Find the points of point clouds that are laid out as this project writes them.

    Args:
        raw: (N,) uint8.
        places: (M, 2) where each message begins and ends.
        fixed: (K,) uint8, what follows a stamp and comes before the length of the points.
        size: bytes of a point.

    Returns:
        (M, 2) where the points of each message begin and end; None where a message is laid out in
        another way.
    """
    at, end = places.T.copy()
    if (end - at < len(fixed) + 2).any():
        return None
    at += 2 + raw[at + 1].astype(np.int64)  # after the stamp
    if (at + len(fixed) >= end).any() or (_bytes_at(raw, at, len(fixed)) != fixed).any():
        return None
    at += len(fixed)
    length = np.zeros(len(at), np.int64)
    more = np.ones(len(at), bool)
    for place in range(LONGEST):
        digit = raw[np.minimum(at, len(raw) - 1)].astype(np.int64)
        length += np.where(more, (digit & 0x7F) << 7 * place, 0)
        at += more
        more &= digit > 0x7F
    if (more | (at + length != end) | (length % size != 0)).any():
        return None
    return np.stack([at, end], 1)


def _bytes_at(raw: NDArray[np.uint8], at: NDArray[np.int64], width: int) -> NDArray[np.uint8]:
    """(N, width) bytes that follow each of some positions; raises IndexError past the end."""
    # overlapping items of so many bytes, of which a few are copied
    items = np.ndarray((max(0, len(raw) - width + 1),), f"V{width}", raw.data, 0, (1,))
    return items[at].view(np.uint8).reshape(len(at), width)
