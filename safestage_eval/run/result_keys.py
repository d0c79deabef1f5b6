"""Key of a result: the bytes of the trace, header, rules, settings and the code."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from safestage_eval.errors import TraceError
from safestage_eval.evidence.trace_identity import code_version
from safestage_eval.formats import EpisodeRef
from safestage_eval.formats.checksum import crc32
from safestage_eval.formats.parquet.dataset_layout import TABLE_FOLDERS
from safestage_eval.formats.parquet.episode_row import read_rows
from safestage_eval.formats.remote_path import RemotePath
from safestage_eval.formats.trace_files import inside_dataset

from .settings import Settings


class Keys:
    """The keys of episodes under the settings of a run.

    A key is made of the checksums of the files of an episode, not of the content hash that they state:
    a file that was damaged is judged anew. It holds wherever the files are. Of a dataset's table of
    headers the row alone counts, so that a dataset may grow. Objects in a store are known by the state
    that the store tells.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings, self._rules = settings, settings.rule_set
        self._path: Path | None = None
        self._found: dict[str, Any] = {}
        """What was found of the files of episodes that are stored together."""

    def of(self, ref: EpisodeRef) -> str | None:
        """32 hexadecimal digits; None where a result may not be kept: then it is judged anew."""
        if ref.problem is not None or not code_version():
            return None
        if self._path != ref.path:
            self._path, self._found = ref.path, {}
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
        looked = " looked at" * (self._settings.look is not None)
        return _digest(f"{code_version()} {header} {bodies} {self._asked(ref)}{looked}")

    def _asked(self, ref: EpisodeRef) -> str:
        """All that a result depends on besides the trace and the code; of a bind file, what it says of the episode."""
        s, bound = self._settings, None
        if (bind := s.bind) is not None:
            task = bind.tasks.get(ref.fields.get("task") or "")
            own, bodies = bind.episodes.get(ref.episode_id), sorted(bind.bodies.items())
            bound = bind.path, bind.every, task, own, bodies, bind.command
        asked = sorted((s.overrides or {}).items()), bound, s.assigned_only, s.strict
        return f"result {self._rules.digest} {asked!r}"

    def _about(self, file: str, ref: EpisodeRef, find: Callable[[Path], Any]) -> Any:
        """What ``find`` tells of a file; None where there is no such file."""
        if file not in self._found:
            path = RemotePath(file) if isinstance(ref.path, RemotePath) else Path(file)
            if isinstance(path, RemotePath) and find is _checksum:
                self._found[file] = path.opened().state if path.is_file() else None
            else:
                self._found[file] = find(path) if path.is_file() else None
        return self._found[file]


def _checksum(path: Path) -> str:
    """CRC-32 and size of all bytes."""
    crc = size = 0
    with path.open("rb") as stream:
        while part := stream.read(1 << 20):
            crc, size = crc32(part, crc), size + len(part)
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
