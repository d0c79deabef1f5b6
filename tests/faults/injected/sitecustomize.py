"""Loaded by every Python process that finds this folder on its path: a call that fails, a clock that jumps.

``SAFESTAGE_FAULTS`` is JSON: ``fail``, the number of the call that fails (0: none), counted over all
processes by the length of the file ``calls``; ``clock``, a seed: the clock jumps by hours to years.
"""

import errno
import io
import json
import os
import random
import stat
import time

CALLS = ("fsync", "replace", "rename", "link", "mkdir", "unlink", "write")


def install(told):
    """Put what fails in the place of the system's calls."""
    if told.get("clock") is not None:
        _jump(random.Random(told["clock"]))
    if told.get("calls"):
        for name in CALLS:
            setattr(os, name, _failing(getattr(os, name), told))
        io.open = _opening(io.open, told)


def _count(told):
    """The number of this call, over all processes."""
    handle = os.open(told["calls"], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    try:
        _WRITE(handle, b".")
        return os.lseek(handle, 0, os.SEEK_CUR)
    finally:
        os.close(handle)


def _failing(call, told):
    def called(*args, **named):
        if call is _WRITE and not stat.S_ISREG(os.fstat(args[0]).st_mode):
            return call(*args, **named)  # a pipe is not on that disk
        if _count(told) == told["fail"]:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return call(*args, **named)

    return called


def _opening(call, told):
    def called(file, mode="r", *args, **named):
        if isinstance(mode, str) and set(mode) & set("wxa") and _count(told) == told["fail"]:
            raise OSError(errno.EIO, os.strerror(errno.EIO), str(file))
        return call(file, mode, *args, **named)

    return called


def _jump(chance):
    now, by = time.time, [0.0]

    def jumped():
        if chance.random() < 0.2:
            by[0] = chance.choice((-1, 1)) * 10 ** chance.uniform(0, 8.5)
        return max(0.0, now() + by[0])

    time.time = jumped
    time.time_ns = lambda: int(jumped() * 1e9)


_WRITE = os.write
if "SAFESTAGE_FAULTS" in os.environ:
    install(json.loads(os.environ["SAFESTAGE_FAULTS"]))
