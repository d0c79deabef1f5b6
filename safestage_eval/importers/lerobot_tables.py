"""Files and columns of a LeRobot dataset.

- v2: ``data/chunk-000/episode_000000.parquet``, one file per episode; ``meta/tasks.jsonl``.
- v3: ``data/chunk-000/file-000.parquet``, several episodes per file; ``meta/tasks.parquet``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval._text.json_text import from_json
from safestage_eval.errors import InputError, TraceError
from safestage_eval.formats.trace_files import arrow_file
from safestage_eval.size_limits import current

from .column_episode import no_column

F64 = NDArray[np.float64]

OWN = {"index", "frame_index", "episode_index", "timestamp", "task_index"}
"""Columns that every LeRobot table has."""


class Tables:
    """The tables of one dataset folder."""

    def __init__(self, path: Path) -> None:
        """Nothing is read yet."""
        self._path = path

    @cached_property
    def files(self) -> dict[int, Path]:
        """Episode → the file that holds its rows."""
        import pyarrow.parquet as pq

        result: dict[int, Path] = {}
        for file in sorted((self._path / "data").rglob("*.parquet")):
            name = re.fullmatch(r"episode_(\d+)", file.stem)
            if name is not None:
                result[int(name[1])] = file
                continue
            with _reading(file):
                numbers = pq.read_table(arrow_file(file), columns=["episode_index"])[
                    "episode_index"
                ]
            for number in set(numbers.to_pylist()):
                result[int(number)] = file
        return result

    def read(self, number: int, wanted: Sequence[str], map_path: str) -> dict[str, F64]:
        """Read (T, k) of the wanted columns of an episode, and of timestamp and task_index.

        Args:
            number: of the episode.
            wanted: names of columns.
            map_path: the map file that names them, for messages.

        Raises:
            SourceError: there is no such column.
            TraceError: there are no rows, or no numbers in them.
        """
        import pyarrow.parquet as pq

        file = self.files.get(number)
        if file is None:
            raise TraceError(f"{self._path}: episode_{number}", "there is no file with its rows")
        with _reading(file):
            metadata = pq.read_metadata(arrow_file(file))
            schema = metadata.schema.to_arrow_schema()
        missing = [column for column in wanted if column not in schema.names]
        if missing:
            there = (n for n in schema.names if n not in OWN)
            raise no_column(map_path, missing[0], f"column of {file.name}", there)
        names = {*wanted, *OWN}
        with _reading(file):
            paths = [metadata.schema.column(i).path for i in range(metadata.num_columns)]
            groups = [metadata.row_group(n) for n in range(metadata.num_row_groups)]
            values = sum(
                max(0, group.column(place).num_values)
                for group in groups
                for place, path in enumerate(paths)
                if path.partition(".")[0] in names
            )
        current().demand_decoded(8 * values, file.stat().st_size, str(file))
        also = [c for c in ("timestamp", "frame_index", "task_index") if c in schema.names]
        read = list(dict.fromkeys([*wanted, *also, "episode_index"]))
        with _reading(file):
            table = pq.read_table(arrow_file(file), columns=[c for c in read if c in schema.names])
        mine = np.ones(len(table), bool)
        if "episode_index" in table.column_names:
            mine = table["episode_index"].to_numpy() == number
        if not mine.any():
            raise TraceError(f"{file}", f"has no rows of episode {number}")
        out = {}
        for column in table.column_names:
            values = table[column].combine_chunks().to_pylist()
            try:
                array = np.asarray(values, np.float64)
            except (ValueError, TypeError):
                raise TraceError(
                    f"{file}: {column}", "rows of different lengths, or no numbers"
                ) from None
            out[column] = array.reshape(len(array), -1)[mine]
        return out

    @cached_property
    def tasks(self) -> dict[int, str]:
        """Task index → instruction."""
        meta = self._path / "meta"
        with _reading(meta):
            return dict(_tasks(meta))


@contextmanager
def _reading(file: Path) -> Iterator[None]:
    """Raises TraceError for what cannot be read."""
    try:
        yield
    except (
        OSError,
        ValueError,
        KeyError,
        TypeError,
        RuntimeError,
        MemoryError,
    ) as error:  # Arrow's
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise TraceError(str(file), f"cannot be read: {reason}.", fix="download it again") from None


def described(path: Path) -> dict[str, Any] | None:
    """Read ``meta/info.json`` of a folder; None if it has none that can be read."""
    try:
        info = from_json((path / "meta" / "info.json").read_text("utf-8"), foreign=True)
    except (OSError, ValueError):
        return None
    return info if isinstance(info, dict) else None


def _tasks(meta: Path) -> Iterator[tuple[int, str]]:
    if (meta / "tasks.jsonl").is_file():
        for line in (meta / "tasks.jsonl").read_text("utf-8").splitlines():
            if line.strip():
                entry = from_json(line, foreign=True)
                yield int(entry["task_index"]), str(entry["task"])
    elif (meta / "tasks.parquet").is_file():
        import pyarrow.parquet as pq

        for entry in pq.read_table(arrow_file(meta / "tasks.parquet")).to_pylist():
            text = entry.get("task", entry.get("__index_level_0__"))
            if text is None:
                raise InputError(str(meta / "tasks.parquet"), "has no column task.")
            yield int(entry["task_index"]), str(text)
