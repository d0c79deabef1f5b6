"""Episodes that do to their process what broken files and libraries do."""

import os
import signal
import time
from dataclasses import fields

from safestage_eval.formats import EpisodeRef


class Crashing(EpisodeRef):
    """Crash like a library that writes where it may not."""

    def open(self, **_):
        os.kill(os.getpid(), signal.SIGSEGV)


class CrashingOnce(EpisodeRef):
    """Its process is killed the first time only: no fault of the episode."""

    def open(self, **options):
        mark = self.path.with_suffix(".mark")
        if not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return EpisodeRef.open(self, **options)


class Hanging(EpisodeRef):
    """Never ends."""

    def open(self, **_):
        while True:
            time.sleep(0.1)


class Swelling(EpisodeRef):
    """Takes all the memory there is, up to a gigabyte."""

    def open(self, **_):
        held = []
        for _ in range(100):
            held.append(os.urandom(1 << 20) * 10)
            time.sleep(0.02)
        raise RuntimeError("it got all of it")


def turned(ref, kind):
    return kind(**{field.name: getattr(ref, field.name) for field in fields(ref)})
