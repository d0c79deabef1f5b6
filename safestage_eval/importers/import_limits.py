"""Limits of memory and time when reading a source."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path

AT_LEAST = 120.0
"""s that looking at a source, or importing an episode, may take however small the source is."""

PER_BYTE = 2e-6
"""s more for each byte of the source: 2 s per MB, some ten times what the slowest formats take."""


@dataclass(frozen=True)
class Limits:
    """Bounds on each look at a source, and on each episode.

    Attributes:
        timeout: s; None: ``AT_LEAST``, and more for large sources.
        memory: bytes that the process which reads may hold; None: any.
    """

    timeout: float | None = None
    memory: int | None = None
    _known: dict[Path, float] = field(default_factory=dict, compare=False, repr=False)

    def seconds(self, source: Path) -> float:
        """Seconds for examining a file or folder, or for reading one episode of it."""
        if self.timeout is not None:
            return self.timeout
        if source not in self._known:
            self._known[source] = AT_LEAST + PER_BYTE * _size(source)
        return self._known[source]


def _size(source: Path) -> int:
    """Bytes of a file, or of all files below a folder."""
    if not source.is_dir():
        return _bytes(source)
    return sum(_bytes(Path(folder, name)) for folder, _, names in os.walk(source) for name in names)


def _bytes(file: Path) -> int:
    try:
        return file.stat().st_size
    except OSError:
        return 0
