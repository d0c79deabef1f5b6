"""Memory that is freed stays with a process that scores."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

ASKS = """
import resource, sys
from safestage_eval import heap
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
