"""The folder of a cache: two files per episode, bounded in size."""

from __future__ import annotations

import contextlib
import hashlib
import os
import time
from pathlib import Path
from typing import Any
from uuid import uuid4

from safestage_eval.formats import EpisodeRef

from .answer_log import Log, append
from .cache_entry import Entry, Value, encode

PARTS = ("measured", "answers")
"""Files of an episode: arrays (cache_entry.py), and the small answers that rest on them (answer_log.py)."""
RECENT = 60.0
"""s in which a file that was used counts as used just now."""
MOST = 4 * 1024**3
"""Bytes that a folder may grow to, unless ``SAFESTAGE_CACHE_SIZE`` (bytes) says otherwise."""


class CacheFolder:
    """Reads and writes files of the cache; a file that cannot be read counts as missing."""

    def __init__(
        self, path: str | Path, most: int | None = None, *, measurements: bool = True
    ) -> None:
        """Open a folder, which need not exist.

        Args:
            path: of the folder.
            most: bytes to prune to; ``SAFESTAGE_CACHE_SIZE`` or ``MOST`` if None.
            measurements: keep series and relations too, and not only verdicts.
        """
        self.path = Path(path).expanduser()
        self.measurements = measurements
        self._last: tuple[EpisodeRef | None, str] = None, ""
        stated = os.environ.get("SAFESTAGE_CACHE_SIZE", "")
        self.most = most if most is not None else int(stated) if stated.isdigit() else MOST

    def file(self, ref: EpisodeRef, part: str) -> Path:
        """The path of one of ``PARTS``, named after where the episode is stored."""
        return Path(self._file(ref, part))

    def _file(self, ref: EpisodeRef, part: str) -> str:
        """Like ``file``; remembers the episode that it was called with last."""
        if self._last[0] is not ref:
            place = f"{os.path.abspath(ref.path)}\n{ref.episode_index}\n{ref.episode_id}"  # noqa: PTH100 - fast
            name = hashlib.sha256(os.fsencode(place)).hexdigest()[:32]
            self._last = ref, f"{self.path}/{name[:2]}/{name}."
        return self._last[1] + part

    def measured(self, ref: EpisodeRef) -> Entry | None:
        """The measurements of an episode, of whatever state of its files."""
        return Entry.read(self._file(ref, "measured"))

    def answers(self, ref: EpisodeRef) -> Log:
        """The answers about an episode, of whatever state of its files."""
        file = self._file(ref, "answers")
        for path in (file, file.removesuffix("answers") + "measured"):
            with contextlib.suppress(OSError):
                if time.time() - os.stat(path).st_mtime > RECENT:  # noqa: PTH116 - fast
                    os.utime(path)  # used just now: pruned last
        return Log.read(file)

    def add(self, ref: EpisodeRef, answers: dict[str, Any], keep: bytes) -> None:
        """Add answers to those that are there; does nothing where the folder cannot be written to.

        ``keep``: lines that stay when a file that has grown too long is begun anew.
        """
        with contextlib.suppress(OSError):
            append(self._file(ref, "answers"), answers, keep)

    def write(self, ref: EpisodeRef, values: dict[str, Value]) -> None:
        """Replace the measurements; does nothing where the folder cannot be written to."""
        if not self.measurements:
            return
        path, data = self.file(ref, "measured"), encode(values)
        new = path.with_name(f".{path.name}.{uuid4().hex[:8]}.part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            new.write_bytes(data)
            new.replace(path)
        except OSError:
            with contextlib.suppress(OSError):
                new.unlink()

    def prune(self) -> int:
        """Remove the entries that were not used for longest until the rest fits; returns how many."""
        found = []
        for path in (file for part in PARTS for file in self.path.glob(f"*/*.{part}")):
            with contextlib.suppress(OSError):
                stat = path.stat()
                found.append((stat.st_mtime_ns, stat.st_size, path))
        for path in self.path.glob("*/.*.part"):  # left by processes that were killed
            with contextlib.suppress(OSError):
                if time.time() - path.stat().st_mtime > 3600:
                    path.unlink()
        total, removed = sum(size for _, size, _ in found), 0
        for _, size, path in sorted(found):
            if total <= self.most:
                break
            with contextlib.suppress(OSError):
                path.unlink()
                removed += 1
            total -= size
        return removed
