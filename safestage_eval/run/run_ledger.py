"""Results of a long run: kept in a database on disk as they come, found again by their keys, read as they are looked at."""

from __future__ import annotations

import json
import shutil
import sqlite3
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkdtemp
from typing import TYPE_CHECKING, overload
from uuid import uuid4
from weakref import finalize

from safestage_eval.errors import InputError
from safestage_eval.verdicts import EpisodeResult
from safestage_eval.verdicts.problem import Problem
from safestage_eval.verdicts.verdict import result_from_json

from .scores import Scores, taken

if TYPE_CHECKING:
    from safestage_eval.formats import EpisodeRef

    from .pool import Numbered
    from .result_keys import Keys
    from .worker import Line

Tell = Callable[[int, int | None], None]

FILE = "results.sqlite"

WAITING, SECONDS = 64, 10.0
"""Results, and s of waiting, after which results are written."""

BUSY = 120.0
"""s to wait for another run that writes to the same folder."""

_BROKEN = (sqlite3.Error, UnicodeDecodeError)
"""What a damaged database raises; its messages may quote bytes of it."""

_TABLES = """
PRAGMA synchronous = NORMAL;
CREATE TABLE IF NOT EXISTS kept (key TEXT PRIMARY KEY, episode TEXT, trace TEXT, line BLOB, sum INT);
CREATE TEMP TABLE run (number INTEGER PRIMARY KEY, key TEXT, path TEXT);
"""

_SHOWN = """
CREATE TEMP TABLE shown AS SELECT min(number) AS number, run.key, path, episode, trace
FROM run JOIN kept USING (key) GROUP BY episode ORDER BY 1
"""

_OTHERS = """
SELECT run.number, run.path, kept.trace = shown.trace, kept.episode, shown.path
FROM run JOIN kept USING (key) JOIN shown USING (episode)
WHERE run.number > shown.number ORDER BY run.number
"""


class Ledger:
    """The outcome of each episode of a run by its number: a kept result, or a problem. Memory stays flat."""

    def __init__(
        self, folder: Path | None, keys: Keys | None = None, progress: Tell | None = None
    ) -> None:
        """Look at what is there already. Raises InputError where the folder cannot be used.

        Args:
            folder: keeps the results; None: a passing one.
            keys: by which results of earlier runs are known.
            progress: called with (done, total) after each episode; total is None until it is known.
        """
        if folder is None:
            folder = Path(mkdtemp(prefix="safestage-results-"))
            finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self._folder, self._keys, self._progress = folder, keys, progress
        self._asked: dict[int, str] = {}
        self._waiting: list[tuple[str, Line]] = []
        self._problems: dict[int, Problem] = {}
        self._since = 0.0
        self._done = self._count = 0
        self._all = False
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._db = _opened(folder / FILE)
        except (OSError, *_BROKEN) as error:
            raise InputError(str(folder), f"cannot be used: {error}.") from None

    def todo(self, refs: Iterable[EpisodeRef]) -> Iterator[Numbered]:
        """The episodes without a result yet."""
        for number, ref in enumerate(refs):
            self._count += 1
            key = None if self._keys is None else self._keys.of(ref)
            there = key is not None and self.find(key) is not None
            own = key or uuid4().hex
            self._db.execute("INSERT INTO run VALUES (?, ?, ?)", (number, own, ref.shown))
            if there:
                self._tell()
            else:
                self._asked[number] = own
                yield number, ref
        self._all = True

    def note(self, number: int, result: Line | Problem) -> None:
        """Take what was found of an episode; results are written together with others."""
        key = self._asked.pop(number)
        if isinstance(result, Problem):
            self._problems[number] = result
        else:
            self._since = self._since if self._waiting else time.monotonic()
            self._waiting.append((key, result))
            if len(self._waiting) >= WAITING or time.monotonic() - self._since >= SECONDS:
                self.flush()
        self._tell()

    def flush(self) -> None:
        """Write what waits. Raises InputError when it cannot be done."""
        rows = [
            (key, line.episode_id, line.trace_hash, packed, _sum(key, *line[1:], packed))
            for key, line in self._waiting
            for packed in [zlib.compress(line.text, 1)]
        ]
        self._waiting.clear()
        with self._failing("results cannot be written there"):
            self._db.execute("BEGIN IMMEDIATE")
            self._db.executemany("INSERT OR REPLACE INTO kept VALUES (?, ?, ?, ?, ?)", rows)
            self._db.execute("COMMIT")

    def find(self, key: str) -> bytes | None:
        """A kept result as it was stored; None where there is none, or a damaged one."""
        try:
            row = self._db.execute("SELECT * FROM kept WHERE key = ?", (key,)).fetchone()
            return None if row is None or _sum(*row[:4]) != row[4] else zlib.decompress(row[3])
        except (*_BROKEN, zlib.error, TypeError):
            return None

    def scores(self, rules: Mapping[str, str]) -> Scores:
        """Each episode once, in the order in which they were found (see ``deduplicate``)."""
        with self._failing("results cannot be read"):
            self._db.execute(_SHOWN)
            others = self._db.execute(_OTHERS).fetchall()
        problems, copies = dict(self._problems), []
        for number, path, same, name, first in others:
            if same:
                copies.append(path)
            else:
                problems[number] = taken(name, path, first)
        ordered = tuple(problems[number] for number in sorted(problems))
        return Scores(StoredResults(self), ordered, rules, tuple(copies))

    def shown(self, place: int) -> tuple[bytes | None, str]:
        """Of the n-th episode the result, and the path of its trace."""
        row = self._db.execute("SELECT key, path FROM shown WHERE rowid = ?", (place + 1,))
        key, path = row.fetchone()
        return self.find(key), path

    def __len__(self) -> int:
        """Episodes with a result, each counted once."""
        return int(self._db.execute("SELECT count(*) FROM shown").fetchone()[0])

    @contextmanager
    def _failing(self, what: str) -> Iterator[None]:
        try:
            yield
        except _BROKEN as error:
            raise InputError(
                str(self._folder), f"{what}: {error}.",
                fix="make room, or another --resume folder; what is written is kept",
            ) from None  # fmt: skip

    def _tell(self) -> None:
        self._done += 1
        if self._progress is not None:
            self._progress(self._done, self._count if self._all else None)


def _opened(path: Path) -> sqlite3.Connection:
    """The database of a folder; one that is damaged is begun anew."""
    for again in (False, True):
        db = sqlite3.connect(path, BUSY, isolation_level=None, check_same_thread=False)
        try:
            db.executescript(_TABLES)
            db.execute("SELECT count(*) FROM kept WHERE sum IS NULL")
            return db
        except _BROKEN as error:
            db.close()
            if again or isinstance(error, sqlite3.OperationalError):  # locked, or no room
                raise
            path.unlink()
    raise AssertionError


def _sum(key: str, episode: str, trace: str, packed: bytes) -> int:
    return zlib.crc32(packed, zlib.crc32(f"{key} {episode} {trace}".encode()))


class StoredResults(Sequence[EpisodeResult]):
    """The results of a ledger: a sequence that holds none of its items."""

    def __init__(self, ledger: Ledger) -> None:
        self._ledger, self._length = ledger, len(ledger)

    def __len__(self) -> int:
        """How many there are."""
        return self._length

    @overload
    def __getitem__(self, index: int) -> EpisodeResult: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[EpisodeResult, ...]: ...
    def __getitem__(self, index: int | slice) -> EpisodeResult | tuple[EpisodeResult, ...]:
        """Read from disk. Raises InputError when a result was damaged meanwhile."""
        if isinstance(index, slice):
            return tuple(self[i] for i in range(*index.indices(self._length)))
        if not -self._length <= index < self._length:
            raise IndexError(index)
        line, path = self._ledger.shown(index % self._length)
        if line is None:
            what = "its result was damaged or removed while the run went on."
            raise InputError(path, what, fix="run it again")
        return result_from_json(json.loads(line), path)
