"""Recordings of vla-eval's harness: ``recording-ID.sqlite``, whose steps are rows of named numbers.

Facts that matter here (pypi.org/project/vla-eval, 0.7.0, recording.py): ``episode_results`` has a row per episode with its
task and status, ``step_rows`` one per step whose ``fields`` are JSON. Which fields there are is the benchmark's choice:
LIBERO has reward, done, success, action and the gripper's pose. Nothing says how long a step takes.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from safestage_eval._text.json_text import from_json
from safestage_eval.errors import TraceError
from safestage_eval.size_limits import current

from .bag_files import SQLITE, begins
from .column_episode import ColumnImporter, Rows, UnmappedError, numbers
from .importer import Settings

F64 = NDArray[Any]

EPISODES = """SELECT sid, eid, task_name, episode_id, status FROM episode_results
    ORDER BY eval_id, task_name, episode_id, sid, eid"""
STEPS = "SELECT fields FROM step_rows WHERE sid = ? AND eid = ? ORDER BY step_id"


class VlaEval(ColumnImporter):
    """One recording."""

    name = "vla-eval"
    title = "recording of vla-eval (recording-*.sqlite)"
    publisher = "vla-eval"

    def __init__(self, path: Path, settings: Settings) -> None:
        """Read which episodes there are.

        Raises:
            SourceError: no ``--robot`` and no columns of poses.
        """
        super().__init__(path, settings)
        if self._columns.success is None and "success" in self.widths():
            self._columns = self._columns.model_copy(update={"success": "success"})

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By the tables of SQLite."""
        if begins(path) != SQLITE:
            return None
        try:
            with _open(path) as base:
                tables = {name for (name,) in base.execute("SELECT name FROM sqlite_master")}
        except TraceError:
            return None
        return (
            "tables step_rows and episode_results"
            if tables >= {"step_rows", "episode_results"}
            else None
        )

    @cached_property
    def _episodes(self) -> dict[str, tuple[str, str, str, str]]:
        """Name → (sid, eid, task, status)."""
        with _open(self.path) as base:
            rows = base.execute(EPISODES).fetchall()
        return {f"{task}/{number}-{i}": (sid, eid, task, status)
                for i, (sid, eid, task, number, status) in enumerate(rows)}  # fmt: skip

    def episodes(self) -> list[str]:
        """``TASK/EPISODE-ROW``, in the order of tasks."""
        return list(self._episodes)

    def _steps(self, name: str) -> dict[str, F64]:
        """Fields of numbers that all steps have: name → (T, k)."""
        sid, eid, *_ = self._episodes[name]
        with _open(self.path) as base:
            texts = [text for (text,) in base.execute(STEPS, (sid, eid))]
        current().demand("frames", len(texts), f"{self.path}: {name}")
        try:
            rows = [from_json(text, foreign=True) for text in texts]
        except ValueError as error:
            raise TraceError(f"{self.path}: {name}", f"a step is no JSON: {error}") from None
        tables = [row for row in rows if isinstance(row, dict)]
        fields = tables[0] if tables and len(tables) == len(rows) else {}
        return numbers(
            {f: [row[f] for row in tables] for f in fields if all(f in r for r in tables)}
        )

    def widths(self) -> dict[str, Sequence[str]]:
        """See ``ColumnImporter.widths``; of the first episode that has steps."""
        for name in self._episodes:
            found = self._steps(name)
            if found:
                return {column: [""] * values.shape[1] for column, values in found.items()}
        return {}

    def no_map(self) -> UnmappedError:
        """See ``ColumnImporter.no_map``."""
        return UnmappedError(
            str(self.path),
            f"its steps have no poses of objects: {', '.join(self.seen()) or 'there are no steps'}.",
            fix='record whole rollouts with safestage_record.vla_eval(benchmark, "traces/") '
            "(docs/record_anywhere.md); --robot FILE judges joints, where a field has their positions; a map "
            "file names fields that a benchmark adds (docs/import/vla_eval.md)",
        )

    def rows(self, name: str, wanted: Sequence[str]) -> Rows:  # noqa: ARG002 — all are read
        """See ``ColumnImporter.rows``."""
        number = list(self._episodes).index(name)
        return Rows(self._steps(name), number, None, self._episodes[name][2])


@contextmanager
def _open(path: Path) -> Iterator[Any]:
    """A connection that changes nothing. Raises TraceError for a damaged file."""
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as base:
            base.execute("PRAGMA trusted_schema = OFF")
            yield base
    except sqlite3.Error as error:
        raise TraceError(str(path), f"cannot be read: {error}.") from None


IMPORTER = VlaEval
