"""LeRobot datasets, v2 and v3 (github.com/huggingface/lerobot); the map file assigns their columns.

- v2: ``data/chunk-000/episode_000000.parquet``, one file per episode; ``meta/tasks.jsonl``.
- v3: ``data/chunk-000/file-000.parquet``, several episodes per file; ``meta/tasks.parquet``.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from safestage_eval._text.json_text import from_json
from safestage_eval.errors import TraceError
from safestage_eval.formats.trace_files import arrow_file

from .column_episode import ColumnImporter, Rows, parquet_columns
from .importer import Settings, json_table

OWN = {"index", "frame_index", "episode_index", "timestamp", "task_index"}
"""Columns that every LeRobot table has."""


class LeRobot(ColumnImporter):
    """One dataset folder."""

    name = "lerobot"
    title = "LeRobot v2 / v3 dataset"

    def __init__(self, path: Path, settings: Settings) -> None:
        """Read the dataset's description.

        Raises:
            UnmappedError: no column map.
        """
        self._info = json_table(path / "meta" / "info.json")
        features = self._info.get("features")
        self._features: dict[str, Any] = features if isinstance(features, dict) else {}
        self.publisher = str(self._info.get("robot_type", ""))
        super().__init__(path, settings)

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By ``meta/info.json`` with a ``codebase_version``."""
        version = json_table(path / "meta" / "info.json").get("codebase_version")
        return None if version is None else f"meta/info.json with codebase_version {version}"

    def episodes(self) -> list[str]:
        """``episode_0``, ``episode_1``, … in order."""
        return [f"episode_{number}" for number in sorted(self._files)]

    def seen(self) -> list[str]:
        """Columns of ``meta/info.json``, without images."""
        return [name for name in self._features if name not in OWN and "image" not in name]

    def widths(self) -> dict[str, Sequence[str]]:
        """See ``ColumnImporter.widths``."""
        return {
            name: self._names(feature) or [""] * shape[0]
            for name, feature in self._features.items()
            if name not in OWN and isinstance(feature, dict)
            and isinstance(shape := feature.get("shape"), list) and len(shape) == 1
            and str(feature.get("dtype", "float")).startswith(("float", "int", "bool"))
        }  # fmt: skip

    def _names(self, feature: dict[str, Any]) -> list[str]:
        """Names of the numbers in a column."""
        names = feature.get("names")
        names = next(iter(names.values()), None) if isinstance(names, dict) else names
        return list(map(str, names)) if isinstance(names, list) else []

    def rows(self, name: str, wanted: Sequence[str]) -> Rows:
        """See ``ColumnImporter.rows``."""
        number = int(name.removeprefix("episode_"))
        if number not in self._files:
            raise TraceError(f"{self.path}: {name}", "there is no file with its rows")
        columns = parquet_columns(self._files[number], {*wanted, *OWN})
        index = columns.get("episode_index")
        if index is not None:
            mine = index[:, 0] == number
            columns = {n: v[mine] for n, v in columns.items() if len(v) == len(mine)}
        count = max(map(len, columns.values()), default=0)
        if not count:
            raise TraceError(str(self._files[number]), f"has no rows of episode {number}")
        t, fps = None, self._info.get("fps")
        if "timestamp" in columns:
            t = columns["timestamp"][:, 0] - columns["timestamp"][0, 0]
        elif isinstance(fps, int | float) and fps > 0:
            t = np.arange(count, dtype=np.float64) / float(fps)
        task = columns.get("task_index")
        instruction = None if task is None else self._tasks.get(int(task[0, 0]))
        return Rows(columns, number, t, instruction)

    @cached_property
    def _files(self) -> dict[int, Path]:
        """Episode → the file that holds its rows."""
        result: dict[int, Path] = {}
        for file in sorted((self.path / "data").rglob("*.parquet")):
            name = re.fullmatch(r"episode_(\d+)", file.stem)
            if name is not None:
                result[int(name[1])] = file
                continue
            index = parquet_columns(file, {"episode_index"}).get("episode_index")
            if index is None:
                raise TraceError(str(file), "cannot be read: it has no episode_index.")
            result |= dict.fromkeys(map(int, np.unique(index)), file)
        return result

    @cached_property
    def _tasks(self) -> dict[int, str]:
        """Task index → instruction."""
        import pyarrow.parquet as pq

        lines, table = self.path / "meta" / "tasks.jsonl", self.path / "meta" / "tasks.parquet"
        entries: list[Any] = []
        try:
            if lines.is_file():
                text = lines.read_text("utf-8").splitlines()
                entries = [from_json(line, foreign=True) for line in text if line.strip()]
            elif table.is_file():
                entries = pq.read_table(arrow_file(table)).to_pylist()
            texts = [entry.get("task", entry.get("__index_level_0__")) for entry in entries]
            return {int(e["task_index"]): str(text) for e, text in zip(entries, texts, strict=True)}
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError) as error:
            reason = (str(error).strip() or type(error).__name__).splitlines()[0]
            raise TraceError(f"{self.path}/meta", f"tasks cannot be read: {reason}.") from None


IMPORTER = LeRobot
