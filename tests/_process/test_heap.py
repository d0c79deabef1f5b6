"""Memory that is freed stays with a process that scores."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

ASKS = """
import resource, sys
from safestage_eval._process import heap
if sys.argv[1] == "kept":
    heap.keep()
def faults():
    for _ in range(20):
        some = [bytearray(1 << 18) for _ in range(16)]
        del some
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
faults()
before = faults()
print(faults() - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="speaks of glibc")
def test_pages_are_not_asked_for_again() -> None:
    asked = {
        how: int(subprocess.run([sys.executable, "-c", ASKS, how], check=True, text=True,
                                capture_output=True).stdout)
        for how in ("usual", "kept")
    }  # fmt: skip
    assert asked["kept"] < 100 < asked["usual"], asked


FRAGMENTED = """
import os
from safestage_eval._process import heap
from safestage_eval._process.memory_limit import resident

def held():
    return resident(os.getpid()) >> 20

heap.keep()
before = held()
bound = heap.Bound((before + 40) << 20)
kept = []
for _ in range(100):  # what goes and what stays, in turn
    # both written, thus resident; the small one fits no hole that is left from the start
    kept.append((bytearray(b"x") * (1 << 20), bytearray(b"x") * (64 << 10)))
kept = [small for _, small in kept]
print(held() - before, bound.hold(), held() - before, bound.hold())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library")
def test_a_process_that_holds_much_hands_free_memory_back():
    done = subprocess.run(
        [sys.executable, "-c", FRAGMENTED], capture_output=True, text=True, check=True
    )
    freed, looked, left, again = done.stdout.split()
    assert int(freed) > 60
    assert looked == "True"
    assert int(left) < 20
    assert again == "False"


EPISODES = """
import os
from safestage_eval._process import heap
from safestage_eval._process.memory_limit import resident

class Episode:
    def __init__(self):
        self.own = self, [bytearray(b"x") * (1 << 18) for _ in range(160)]  # 40 MB in a cycle

heap.keep()
bound = heap.Bound(1)  # it holds more from the beginning
before, looked = resident(os.getpid()), []
for _ in range(12):
    Episode()
    looked.append(bound.hold())
print(*map(int, looked), (resident(os.getpid()) - before) >> 20)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="another C library")
def test_what_each_episode_takes_is_not_handed_back_each_time():
    done = subprocess.run(
        [sys.executable, "-c", EPISODES], capture_output=True, text=True, check=True
    )
    *looked, left = done.stdout.split()
    assert looked[0] == "1"
    assert looked[1:] == ["0"] * 11
    assert int(left) < 60, "cycles are collected after each episode"
