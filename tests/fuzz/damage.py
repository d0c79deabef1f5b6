"""Damage to bytes: what disks, networks and strangers do to a file."""

from __future__ import annotations

import struct
from collections.abc import Callable
from random import Random

HUGE = (0, 1, 127, 128, 255, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**62, 2**63, 2**64 - 1)
FLOATS = (float("nan"), float("inf"), -float("inf"), 0.0, 3e38, -1e30, 1e-45)

Kind = Callable[[Random, bytes, int], bytes]


def damaged(rng: Random, data: bytes) -> tuple[bytes, str]:
    """The bytes with one damage, often near their begin or end, and what it was."""
    if not data:
        return rng.randbytes(8), "bytes in an empty file"
    at = rng.randrange(len(data))
    if rng.random() < 0.5:
        near = min(int(rng.random() ** 2 * 100), len(data) - 1)
        at = rng.choice((near, len(data) - 1 - near))
    name = rng.choice(list(KINDS))
    return KINDS[name](rng, data, at), f"{name} at {at} of {len(data)}"


def _bit(rng: Random, data: bytes, at: int) -> bytes:
    return data[:at] + bytes([data[at] ^ 1 << rng.randrange(8)]) + data[at + 1 :]


def _over(data: bytes, at: int, new: bytes) -> bytes:
    """Other bytes in the place of as many."""
    return data[:at] + new + data[at + len(new) :]


def _number(rng: Random, data: bytes, at: int) -> bytes:
    size = rng.choice((1, 2, 4, 8))
    return _over(data, at, (rng.choice(HUGE) & (1 << 8 * size) - 1).to_bytes(size, "little"))


def _exchanged(rng: Random, data: bytes, at: int) -> bytes:
    size, other = rng.choice((4, 32, 256)), rng.randrange(len(data))
    a, b = min(at, other), max(at, other)
    if b - a < size:
        return _bit(rng, data, at)
    return (
        data[:a] + data[b : b + size] + data[a + size : b] + data[a : a + size] + data[b + size :]
    )


KINDS: dict[str, Kind] = {
    "bit": _bit,
    "byte": lambda rng, data, at: _over(data, at, rng.randbytes(1)),
    "number": _number,
    "float": lambda rng, data, at: _over(data, at, struct.pack("<f", rng.choice(FLOATS))),
    "cut": lambda rng, data, at: data[:at],
    "headless": lambda rng, data, at: data[at:],
    "zeros": lambda rng, data, at: _over(data, at, bytes(rng.choice((8, 64, 512, 4096)))),
    "gone": lambda rng, data, at: data[:at] + data[at + rng.choice((1, 2, 8, 64, 512)) :],
    "twice": lambda rng, data, at: data[:at] + data[max(0, at - rng.choice((1, 8, 64))) :],
    "noise": lambda rng, data, at: _over(data, at, rng.randbytes(rng.choice((2, 8, 32)))),
    "more": lambda rng, data, at: data[:at] + rng.randbytes(rng.choice((1, 4, 64))) + data[at:],
    "exchanged": _exchanged,
}
LOSSES = ("cut", "headless")
"""Damage after which what was there is seen to be gone."""
