"""Recordings of a robot's joints alone: CSV, Parquet, NumPy archives and HDF5 (raw DROID, ALOHA, robomimic).

A row is a sample. A table may have one number in a column or several; numbered columns (``q1``, ``q2``, …) are one
column as well. The robot is that of ``--robot``; objects are where the map file says that they were tracked.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import TraceError
from safestage_eval.size_limits import current

from . import hdf5
from .column_episode import ColumnImporter, Rows, UnmappedError, numbers, parquet_columns
from .joint_columns import grouped, may_be_joints, plain
from .known_files import described
from .npz_arrays import npz_arrays, npz_names
from .robot_file import load_robot

F64 = NDArray[np.float64]

TIMES = {"time": 1.0, "t": 1.0, "timestamp": 1.0, "time_s": 1.0, "timestamp_s": 1.0,
         "time_ms": 1e-3, "timestamp_ms": 1e-3, "time_ns": 1e-9, "timestamp_ns": 1e-9}  # fmt: skip
"""Columns of time by their last part → s in their unit."""

EPISODES = ("episode_index", "episode", "episode_id")
NAMED = "joints by name"
"""The columns of one number that are called as joints of the robot are, together."""


class JointTable(ColumnImporter):
    """One file."""

    name = "joints"
    title = "table of joint positions (CSV, Parquet, npz, HDF5)"

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By a column that may be joint positions, in a file of a kind that is read here."""
        beside = [folder / "meta" / "info.json" for folder in path.parents[:4]]
        if not path.is_file() or any(
            info.is_file() for info in beside
        ):  # a part of a LeRobot dataset
            return None
        names = _names(path)
        found = [name for name in names if may_be_joints(name)]
        if path.suffix.lower() in (".csv", ".parquet"):  # its joints may have names of their own
            found += [name for name in names if name.lower() in TIMES]
        return f"a column {found[0]}" if found else None

    def no_map(self) -> UnmappedError:
        """See ``ColumnImporter.no_map``."""
        known, what = described(self.path), "has joint positions and no poses of objects."
        if known is not None:
            what = known.what
        elif not any(may_be_joints(column) for column in _names(self.path)):
            what = "has a column of time, none that is called joint positions, and no poses of objects."
        fix = "--robot FILE, the robot's URDF or MJCF, judges its joints alone (docs/import/joints.md)"
        also = f"; {known.fix}" if known is not None and known.fix else ""
        return UnmappedError(str(self.path), what, fix=fix + also)

    def episodes(self) -> list[str]:
        """``episode_0``, …: demonstrations, or parts with the same number in a column of episodes."""
        return list(self._episodes)

    @cached_property
    def _episodes(self) -> dict[str, Any]:
        """Episode → its group in an HDF5 file; in other files its number in the column of episodes, None of all rows."""
        if hdf5.is_hdf5(self.path):
            with hdf5.open_hdf5(self.path) as file, hdf5.layout(str(self.path)):
                groups = [group.name for group in hdf5.demos(file)] or ["/"]
            return {f"episode_{number}": name for number, name in enumerate(groups)}
        column = self._episode_column
        if column is None:
            return {"episode_0": None}
        return {f"episode_{number:.0f}": number for number in np.unique(column)}

    @cached_property
    def _table(self) -> dict[str, F64]:
        """All columns of numbers of a file that is no HDF5: name → (N, k)."""
        kind, size = self.path.suffix.lower(), self.path.stat().st_size
        if kind == ".parquet":
            return parquet_columns(self.path)
        if kind == ".npz":
            return numbers(npz_arrays(self.path, npz_names(self.path)))
        from pyarrow import csv

        current().demand_decoded(size, size, str(self.path))
        try:
            table = csv.read_csv(self.path)
        except (OSError, ValueError, KeyError) as error:
            reason = str(error).splitlines()[0]
            raise TraceError(str(self.path), f"cannot be read: {reason}") from None
        return numbers({name.strip(): table[name].to_pylist() for name in table.column_names})

    @property
    def _episode_column(self) -> F64 | None:
        return next((self._table[n][:, 0] for n in EPISODES if n in self._table), None)

    def _single(self, name: str) -> dict[str, F64]:
        """The columns of an episode as they stand: those of the most frequent length."""
        where, part = f"{self.path}: {name}", self._episodes[name]
        if hdf5.is_hdf5(self.path):
            with hdf5.open_hdf5(self.path) as file, hdf5.layout(where):
                found = [n for n, data in hdf5.datasets(file[part]) if _is_table(data)]
                columns = {n: hdf5.rows(file[part], n, where) for n in found}
        else:
            mine = slice(None) if part is None else self._episode_column == part
            columns = {n: values[mine] for n, values in self._table.items()}
        if not columns:
            raise TraceError(where, "has no columns of numbers")
        lengths = [len(values) for values in columns.values()]
        length = max(set(lengths), key=lengths.count)
        return {n: values for n, values in columns.items() if len(values) == length}

    @cached_property
    def _together(self) -> dict[str, tuple[str, ...]]:
        """Columns that are made of others, of one number each."""
        first = self._single(self.episodes()[0])
        single = [name for name, values in first.items() if values.shape[1] == 1]
        made = grouped(single)
        if self.settings.robot is not None:
            known = {j.name for j in load_robot(self.settings.robot, self.settings.assets).joints}
            called = {plain(name): name for name in single if plain(name) in known}
            if called:
                made[NAMED] = tuple(called.values())
        return made

    def widths(self) -> dict[str, Sequence[str]]:
        """See ``ColumnImporter.widths``."""
        first = self._single(self.episodes()[0])
        return self._together | {n: [""] * v.shape[1] for n, v in first.items()}

    def rows(self, name: str, wanted: Sequence[str]) -> Rows:  # noqa: ARG002 — all are read
        """See ``ColumnImporter.rows``."""
        columns, t = self._single(name), None
        for column, values in columns.items():
            by = TIMES.get(column.rpartition("/")[2].rpartition(".")[2].lower())
            if by is not None and values.shape[1] == 1:
                t = by * (values[:, 0] - values[0, 0])
                break
        made = {
            stem: np.concatenate([columns[part] for part in parts], axis=1)
            for stem, parts in self._together.items()
            if all(part in columns for part in parts)
        }
        return Rows(columns | made, int(name.removeprefix("episode_")), t)


def _is_table(data: Any) -> bool:
    return data.ndim in (1, 2) and data.dtype.kind in "fiub" and data.shape[0] > 1


def _names(path: Path) -> list[str]:
    """Names of the columns of a file that is read here; none of another."""
    kind = path.suffix.lower()
    single: list[str] = []
    try:
        if hdf5.is_hdf5(path):
            with hdf5.open_hdf5(path) as file, hdf5.layout(str(path)):
                demos = hdf5.demos(file)
                if any("states" in demo for demo in demos):
                    return []
                found = hdf5.datasets(demos[0] if demos else file)
                return [name for name, data in found if _is_table(data)]
        if kind == ".npz":
            return sorted(npz_names(path))
        if kind == ".csv":
            with path.open(encoding="utf-8") as stream:
                head = stream.readline(1 << 16)
            single = [word.strip().strip('"') for word in head.split(",")]
        elif kind == ".parquet":
            import pyarrow.parquet as pq

            single = pq.read_schema(path).names
    except (OSError, ValueError):
        return []
    return [*grouped(single), *single]


IMPORTER = JointTable
