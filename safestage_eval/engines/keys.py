"""What a result depends on, in one key: trace, header, rules, everything else asked, and the code."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from safestage_eval.cache import question
from safestage_eval.cache.identity import code_version
from safestage_eval.errors import TraceError
from safestage_eval.formats import EpisodeRef
from safestage_eval.formats.dataset_reader import read_rows
from safestage_eval.formats.mcap_reader import read_header

from .settings import Settings

_PLACE = ("episode_index", "file")
"""Columns that say where an episode is stored and nothing about it."""


class Keys:
    """The keys of episodes under the settings of a run.

    A key holds wherever the episode is stored: its trace is in it by the content hash that the
    file states, which ``safestage validate`` compares with the content.
    """

    def __init__(self, settings: Settings) -> None:
        self._settings, self._rules = settings, settings.load()
        self._file: Path | None = None
        self._headers: dict[int | None, str] = {}

    def of(self, ref: EpisodeRef) -> str | None:
        """32 hexadecimal digits; None where a result may not be kept: then it is judged anew."""
        if ref.problem is not None or ref.content_hash is None or not code_version():
            return None
        header = self._header(ref)
        if header is None:
            return None
        s = self._settings
        asked = question(
            ref, self._rules, s.overrides, s.bind, s.backend, assigned_only=s.assigned_only
        )
        return _digest(f"{code_version()} {ref.content_hash} {header} {asked}")

    def _header(self, ref: EpisodeRef) -> str | None:
        """A digest of everything that the header says: roles and goal are not in the trace's hash."""
        if self._file != ref.path:
            try:
                self._headers = _headers(ref)
            except (TraceError, OSError):
                self._headers = {}
            self._file = ref.path
        return self._headers.get(ref.episode_index)


def _headers(ref: EpisodeRef) -> dict[int | None, str]:
    """Those of all episodes in the same file."""
    if ref.format == "mcap":
        return {None: _digest(read_header(ref.path)[0].model_dump_json())}
    found: dict[int | None, str] = {}
    for row in read_rows(ref.path):
        index = row["episode_index"]
        said = {name: value for name, value in row.items() if name not in _PLACE}
        found[index] = _digest(json.dumps(said, sort_keys=True, default=str))
    return found


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:32]
