"""The machine that a figure was measured on."""

from __future__ import annotations

import platform
import time
from pathlib import Path


def processor() -> str:
    """The processor's name as the system tells it."""
    try:
        for line in Path("/proc/cpuinfo").read_text("utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def machine() -> str:
    """The line that a benchmark begins with: processor, Python, and how fast both are just now."""
    return f"{processor()}, Python {platform.python_version()}, plain loop {pace():.1f} ms"


def pace() -> float:
    """Time (ms of the processor) that a fixed loop of plain Python takes, the least of nine.

    On a machine that is shared, the same code may take twice as long an hour later. Two figures from
    different runs compare as their ratios to this one.
    """
    times = []
    for _ in range(9):
        start = time.process_time()
        total = 0
        for number in range(200_000):
            total += number & 7
        times.append(time.process_time() - start)
    return min(times) * 1e3
