"""Damage to bytes: what disks, networks and strangers do to a file."""

from __future__ import annotations

from collections.abc import Sequence
from random import Random

SIZES = (1, 2, 4, 8)
HUGE = (0, 1, 127, 128, 255, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63, 2**64 - 1)


def damaged(rng: Random, data: bytes, edges: Sequence[int] = ()) -> tuple[bytes, str]:
    """The bytes with one damage, half of the time at one of the edges, and what it was."""
    if not data:
        return bytes(rng.randrange(256) for _ in range(8)), "bytes in an empty file"
    at = place(rng, data, edges)
    what = rng.choice(_KINDS)
    return what(rng, data, at), f"{what.__name__.strip('_')} at {at}"


def place(rng: Random, data: bytes, edges: Sequence[int]) -> int:
    """A position in the bytes, near an edge half of the time."""
    if edges and rng.random() < 0.5:
        at = rng.choice(edges) + rng.choice((-1, 0, 0, 0, 1, 4, 8))
        return min(max(at, 0), len(data) - 1)
    return rng.randrange(len(data))


def _bit(rng: Random, data: bytes, at: int) -> bytes:
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]


def _byte(rng: Random, data: bytes, at: int) -> bytes:
    return (
        data[:at] + bytes([rng.choice((0, 1, 127, 128, 255, rng.randrange(256)))]) + data[at + 1 :]
    )


def _number(rng: Random, data: bytes, at: int) -> bytes:
    size = rng.choice(SIZES)
    number = rng.choice(HUGE) & (1 << 8 * size) - 1
    return data[:at] + number.to_bytes(size, "little") + data[at + size :]


def _cut(rng: Random, data: bytes, at: int) -> bytes:
    return data[:at]


def _headless(rng: Random, data: bytes, at: int) -> bytes:
    return data[at:]


def _zeros(rng: Random, data: bytes, at: int) -> bytes:
    size = min(rng.choice((8, 64, 512, 4096)), len(data) - at)
    return data[:at] + bytes(size) + data[at + size :]


def _gone(rng: Random, data: bytes, at: int) -> bytes:
    return data[:at] + data[at + rng.choice((1, 2, 8, 64, 512)) :]


def _twice(rng: Random, data: bytes, at: int) -> bytes:
    return data[:at] + data[max(0, at - rng.choice((1, 8, 64, 512))) :]


def _noise(rng: Random, data: bytes, at: int) -> bytes:
    size = min(rng.choice((2, 8, 32)), len(data) - at)
    return data[:at] + rng.randbytes(size) + data[at + size :]


def _more(rng: Random, data: bytes, at: int) -> bytes:
    return data[:at] + rng.randbytes(rng.choice((1, 4, 64))) + data[at:]


def _exchanged(rng: Random, data: bytes, at: int) -> bytes:
    size = rng.choice((4, 32, 256))
    other = rng.randrange(len(data))
    a, b = min(at, other), max(at, other)
    if b - a < size:
        return _bit(rng, data, at)
    return (
        data[:a] + data[b : b + size] + data[a + size : b] + data[a : a + size] + data[b + size :]
    )


_KINDS = (
    _bit, _bit, _byte, _number, _number, _cut, _headless, _zeros, _gone, _twice, _noise, _more,
    _exchanged,
)  # fmt: skip
