"""Key of a result: trace, header, rules, settings and the code."""

from __future__ import annotations

import hashlib
import json
from contextlib import suppress
from pathlib import Path

from safestage_eval.errors import TraceError
from safestage_eval.evidence.answer_log import Log, append
from safestage_eval.evidence.trace_identity import code_version
from safestage_eval.formats import EpisodeRef
from safestage_eval.formats.parquet.episodes_table import read_rows

from .result_question import result_question
from .settings import Settings

_PLACE = ("episode_index", "file")
"""Columns that say where an episode is stored and nothing about it."""
_MOST = 1 << 29
"""Bytes that digests of headers may take; an episode's takes about 40."""


class Keys:
    """The keys of episodes under the settings of a run.

    A key holds wherever the episode is stored. The trace is in it by the content hash and the digests
    of every column that the file states; it is not read again. That is sound as far as reading is: a
    result is kept only if what was read for it had these digests (other data are a problem, and
    problems are not kept), so a result that is used again is right for the data that the file states.
    A file that was given other data since, under the same header, is found when it is next judged,
    and by ``safestage validate``, which compares everything with the hash.

    Digests of headers are kept by the bytes of the file of ``meta/episodes`` that they come from, so
    that a file that was read before is understood no more.
    """

    def __init__(self, settings: Settings, known: Path | None = None) -> None:
        """``known``: file of digests of headers from before; None: none is kept."""
        self._settings, self._rules = settings, settings.rule_set
        self._known = known
        self._log = Log(b"") if known is None else Log.read(known)
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
        asked = result_question(
            ref, self._rules, s.overrides, s.bind, s.backend, assigned_only=s.assigned_only
        )
        looked = " looked at" * (s.look is not None)
        return _digest(f"{code_version()} {ref.content_hash} {header} {asked}{looked}")

    def _header(self, ref: EpisodeRef) -> str | None:
        """A digest of everything that the header says: roles and goal are not in the trace's hash."""
        if self._file != ref.path:
            try:
                self._headers = self._headers_of(ref)
            except (TraceError, OSError):
                self._headers = {}
            self._file = ref.path
        return self._headers.get(ref.episode_index)

    def _headers_of(self, ref: EpisodeRef) -> dict[int | None, str]:
        """Those of all episodes in the same file, from before or read now."""
        if ref.format != "parquet" or self._known is None:
            return _headers(ref)
        before = _digest_of_file(ref.path)
        logged = self._log.get(before)
        if logged is not None:
            return dict(logged)
        headers = _headers(ref)
        if _digest_of_file(ref.path) == before:
            with suppress(OSError):
                append(self._known, {before: list(headers.items())}, most=_MOST)
        return headers


def _headers(ref: EpisodeRef) -> dict[int | None, str]:
    """Those of all episodes in the same file."""
    if ref.format == "mcap":
        from safestage_eval.formats.mcap.mcap_reader import read_header

        return {None: _digest(read_header(ref.path)[0].model_dump_json())}
    headers: dict[int | None, str] = {}
    for row in read_rows(ref.path):
        index = row["episode_index"]
        said = {name: value for name, value in row.items() if name not in _PLACE}
        headers[index] = _digest(json.dumps(said, sort_keys=True, default=str))
    return headers


def _digest_of_file(path: Path) -> str:
    with path.open("rb") as stream:
        return _digest(f"{code_version()} {hashlib.sha256(stream.read()).hexdigest()}")


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:32]
