"""The messages of a chunk: found, compared with the layout they should have, and copied.

None of these functions believes a length before it has compared it with the bytes that there are.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from safestage_eval._process.compiled import helper, kernel

from .mcap_arrays import CHANNEL, HEAD, LONGEST, MESSAGE, PREFIX

_NOT_FINITE = np.uint32(0x7F800000)
"""The exponent's bits of a float32, which are all set in infinity and NaN alone."""


@kernel
def find_messages(raw: Any, at: Any, topics: Any, out: Any, counts: Any) -> Any:
    """Find the messages of a block of records, up to the next one that declares a channel.

    Args:
        raw: (N,) uint8, whole records one after the other.
        at: where to begin.
        topics: (65536,) number of the topic of a channel; -1 for those that nobody wants.
        out: (K, M, 2) int64 to be filled: where the data of a topic's messages begin and end.
        counts: (K,) how many of each topic's are filled; goes on from there.

    Returns:
        Where the next channel record begins, or a message for which there is no room; the length of
        the block at its end; -1 for bytes that are no records.
    """
    size = len(raw)
    while at < size:
        if size - at < PREFIX:
            return -1
        length = np.uint64(0)
        for i in range(8):
            length |= np.uint64(raw[at + 1 + i]) << np.uint64(8 * i)
        begin = at + PREFIX
        if length > np.uint64(size - begin):
            return -1
        end = begin + np.int64(length)
        if raw[at] == CHANNEL:
            break
        if raw[at] == MESSAGE:
            if end - begin < 2:
                return -1
            topic = topics[np.int64(raw[begin]) | np.int64(raw[begin + 1]) << 8]
            if topic >= 0:
                count = counts[topic]
                if count == out.shape[1]:
                    break
                out[topic, count, 0], out[topic, count, 1] = min(begin + HEAD, end), end
                counts[topic] += 1
        at = end
    return at


@kernel
def copy_frames(
    raw: Any, places: Any, first: Any, between: Any, moves: Any, parts: Any, rows: Any, words: Any,
    numbers: Any, tolerance: float,
) -> int:  # fmt: skip
    """Copy the fields of messages that are laid out like the first one, side by side.

    Args:
        raw: (N,) uint8.
        places: (M, 2) where each message begins and ends.
        first: (S,) uint8, a message.
        between: (K,) which of its bytes are no values: all messages must share them.
        moves: (F, 3) where a field's values begin in a message, how many bytes they are, and where
            they begin in a row.
        parts: (4,) first and last number of a row that belongs to bodies, and of their orientations.
        rows: (M, W) uint8 to be filled.
        words: the same as uint32 (M, W / 4).
        numbers: the same as float32.
        tolerance: how far the square of an orientation's norm may be from 1.

    Returns:
        -1 where a message is laid out in another way; else how many are not sound for sure: all
        numbers of bodies finite, and orientations of unit norm.
    """
    bad = 0
    for m in range(len(places)):
        begin = places[m, 0]
        if places[m, 1] - begin != len(first):
            return -1
        message = raw[begin : places[m, 1]]
        unlike = 0
        for k in range(len(between)):
            unlike |= message[between[k]] ^ first[between[k]]
        if unlike:
            return -1
        for f in range(len(moves)):
            source = message[moves[f, 0] : moves[f, 0] + moves[f, 1]]
            target = rows[m, moves[f, 2] : moves[f, 2] + moves[f, 1]]
            for k in range(len(target)):
                target[k] = source[k]
        bad += not _sound(words[m, parts[0] : parts[1]], numbers[m, parts[2] : parts[3]], tolerance)
    return bad


@helper
def _sound(words: Any, turns: Any, tolerance: Any) -> Any:
    """True if numbers (by their bits) are finite, and quaternions one after the other near unit norm."""
    highest = np.uint32(0)
    for k in range(len(words)):
        highest = max(highest, words[k] & _NOT_FINITE)
    off = 0.0
    for q in range(len(turns) // 4):
        w, x = np.float64(turns[4 * q]), np.float64(turns[4 * q + 1])
        y, z = np.float64(turns[4 * q + 2]), np.float64(turns[4 * q + 3])
        off = max(off, abs(w * w + x * x + y * y + z * z - 1.0))
    return highest != _NOT_FINITE and off < tolerance


@kernel
def find_points(raw: Any, places: Any, fixed: Any, size: int, out: Any) -> Any:
    """Find the points of point clouds that are laid out as this project writes them.

    Args:
        raw: (N,) uint8.
        places: (M, 2) where each message begins and ends.
        fixed: (K,) uint8, what follows a stamp and comes before the length of the points.
        size: bytes of a point.
        out: (M, 2) to be filled: where the points of a message begin and end.

    Returns:
        How many bytes of points there are; -1 where a message is laid out in another way.
    """
    total = np.int64(0)
    for m in range(len(places)):
        at, end = places[m, 0], places[m, 1]
        if end - at < len(fixed) + 2:
            return -1
        at += 2 + np.int64(raw[at + 1])  # after the stamp
        if at + len(fixed) >= end:
            return -1
        unlike = 0
        own = raw[at : at + len(fixed)]
        for k in range(len(fixed)):
            unlike |= own[k] ^ fixed[k]
        if unlike:
            return -1
        at += len(fixed)
        length, shift = np.int64(0), 0
        for place in range(LONGEST + 1):
            if place == LONGEST or at == end:
                return -1
            digit = np.int64(raw[at])
            length |= (digit & 127) << shift
            shift += 7
            at += 1
            if digit < 128:
                break
        if at + length != end or length % size:
            return -1
        out[m, 0], out[m, 1] = at, end
        total += length
    return total


@kernel
def copy_points(raw: Any, places: Any, rows: Any) -> None:
    """Copy the points of several messages, one after the other.

    Args:
        raw: (N,) uint8.
        places: (M, 2) where the points of each message begin and end.
        rows: (R,) uint8 to be filled.
    """
    to = 0
    for m in range(len(places)):
        source = raw[places[m, 0] : places[m, 1]]
        target = rows[to : to + len(source)]
        for k in range(len(source)):
            target[k] = source[k]
        to += len(source)
