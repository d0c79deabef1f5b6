"""HDF5 files whose library goes round for ever, and processes that do what such a library does."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from safestage_eval.formats.atomic import replacing

SIZE = 8
"""Bytes of a length, where h5py says nothing else."""


def objects(data: bytes) -> tuple[int, list[int]]:
    """Where the only collection of texts begins, and where each of its objects does; the last is free."""
    begin = data.index(b"GCOL")
    end = begin + int.from_bytes(data[begin + 8 : begin + 16], "little")
    at, found = begin + 16, []
    while at + 16 <= end:
        found.append(at)
        size = int.from_bytes(data[at + 8 : at + 16], "little")
        at += size if data[at : at + 2] == b"\0\0" else 16 + -(-size // 8) * 8
    assert at == end
    return begin, found


def without_end(path: Path) -> None:
    """Give a text of a file no size, as the fuzzing campaign did it."""
    data = bytearray(path.read_bytes())
    _, places = objects(bytes(data))
    free = places[-1]
    data[free + 8 : free + 16] = bytes(8)
    path.write_bytes(data)


def opened(folder):
    """Answers a word by doing what it says."""

    def answer(word):
        if word == "hang":
            with replacing(folder / "half.txt") as part:
                part.write_text("half")
                while True:
                    time.sleep(0.05)
        if word == "die":
            os.kill(os.getpid(), signal.SIGSEGV)
        if word == "die once" and not (folder / "mark").exists():
            (folder / "mark").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        held = []
        while word == "swell" and len(held) < 100:
            held.append(os.urandom(1 << 20) * 10)
            time.sleep(0.01)
        return word.upper()

    return answer
