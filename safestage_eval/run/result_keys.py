"""Key of a result: the bytes of the trace, header, rules, settings and the code."""

from __future__ import annotations

import hashlib
import json
import os
import time
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from safestage_eval.errors import TraceError
from safestage_eval.evidence.trace_identity import code_version
from safestage_eval.formats import EpisodeRef
from safestage_eval.formats.parquet.dataset_layout import TABLE_FOLDERS
from safestage_eval.formats.parquet.episodes_table import read_rows
from safestage_eval.formats.remote_path import RemotePath
from safestage_eval.formats.trace_files import inside_dataset

from .answer_log import Log, append
from .result_question import result_question
from .settings import Settings

RACY = 2_000_000_000
"""ns: a file that changed less than this before it was looked at may change again unnoticed, because
some file systems keep time no finer."""

_MOST = 1 << 29
"""Bytes that what is kept of files may take; an episode's takes about 500."""


class Keys:
    """The keys of episodes under the settings of a run.

    A key is made of the checksums of the files of an episode, not of the content hash that they state:
    a file that was damaged is judged anew. It holds wherever the files are. Of a dataset's table of
    headers the row alone counts, so that a dataset may grow. Objects in a store are known by the state
    that the store tells.

    Checksums and digests of headers are kept by what the operating system says of the file (size, times, number), so
    that a file is read again only where it was touched.
    """

    def __init__(self, settings: Settings, known: Path | None = None) -> None:
        """``known``: file of what was found of files before; None: none is kept."""
        self._settings, self._rules = settings, settings.rule_set
        self._known = known
        self._log = Log(b"") if known is None else Log.read(known)
        self._file: Path | None = None
        self._found: dict[str, Any] = {}
        """What was found of the files of episodes that are stored together."""

    def of(self, ref: EpisodeRef) -> str | None:
        """32 hexadecimal digits; None where a result may not be kept: then it is judged anew."""
        if ref.problem is not None or not code_version():
            return None
        if self._file != ref.path:
            self._file, self._found = ref.path, {}
        place = str(ref.path)
        header: str | None = ""
        files = [place]
        try:
            if ref.format == "parquet":
                header = dict(self._about(place, ref, _headers) or ()).get(ref.episode_index)
                dataset, name = ref.path.parents[2], f"{ref.stored_in}.parquet"
                files = [
                    str(inside_dataset(dataset, table, name, place)) for table in TABLE_FOLDERS
                ]
            bodies = [self._about(file, ref, _checksum) for file in files]
        except (TraceError, OSError):
            return None
        if header is None:
            return None
        s = self._settings
        asked = result_question(
            ref, self._rules, s.overrides, s.bind, assigned_only=s.assigned_only, strict=s.strict
        )
        looked = " looked at" * (s.look is not None)
        return _digest(f"{code_version()} {header} {bodies} {asked}{looked}")

    def _about(self, file: str, ref: EpisodeRef, find: Callable[[Path], Any]) -> Any:
        """What ``find`` tells of a file, from before or found now; None where there is no such file."""
        if file not in self._found:
            if isinstance(ref.path, RemotePath):
                path = RemotePath(file)
                state = path.source().state if find is _checksum and path.is_file() else None
                self._found[file] = state or (find(path) if find is _headers else None)
            else:
                self._found[file] = self._of_file(file, find)
        return self._found[file]

    def _of_file(self, file: str, find: Callable[[Path], Any]) -> Any:
        noticed, before = time.time_ns(), _status(file)
        if before is None:
            return None
        key = _digest(f"{code_version()} {find.__name__} {before}")
        known = self._log.get(key)
        if known is None:
            known = find(Path(file))
            settled = max(before[1:3]) <= noticed - RACY and _status(file) == before
            if settled and self._known is not None:
                with suppress(OSError):
                    append(self._known, {key: known}, most=_MOST)
        return known


def _status(file: str) -> tuple[int, ...] | None:
    """Size, times, number and device; None where there is no such file."""
    try:
        found = os.stat(file)  # noqa: PTH116 - pathlib takes longer
    except FileNotFoundError:
        return None
    return found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_ino, found.st_dev


def _checksum(path: Path) -> str:
    """CRC-32 and size of all bytes."""
    crc = size = 0
    with path.open("rb") as stream:
        while part := stream.read(1 << 20):
            crc, size = zlib.crc32(part, crc), size + len(part)
    return f"{crc:08x} {size}"


def _headers(path: Path) -> list[tuple[int, str]]:
    """Index and digest of what the header of each episode says: roles and goal, too."""
    headers = []
    for row in read_rows(path):
        row.pop("file", None)  # where it is stored
        said = json.dumps(row, sort_keys=True, default=str)
        headers.append((row["episode_index"], _digest(said)))
    return headers


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:32]
