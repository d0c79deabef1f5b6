"""Recordings of a robot's joints alone: CSV, Parquet, NumPy archives and HDF5 (raw DROID, ALOHA, robomimic).

A row is a sample. A table may have one number in a column or several; numbered columns (``q1``, ``q2``, …) are one
column as well. The robot is that of ``--robot``; objects are where the map file says that they were tracked.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.errors import InputError, TraceError
from safestage_eval.size_limits import current

from . import hdf5
from .column_episode import ColumnImporter, Rows, no_column
from .importer import Settings, SourceError
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

    def __init__(self, path: Path, settings: Settings) -> None:
        """Read which columns there are.

        Raises:
            SourceError: no ``--robot`` and no columns of poses.
        """
        if settings.robot is None and settings.map.columns is None:
            known = described(path)
            what = "has joint positions and no poses of objects."
            if known is not None:
                what = known.what
            elif not any(may_be_joints(column) for column in _names(path)):
                what = "has a column of time, none that is called joint positions, and no poses of objects."
            fix = "--robot FILE, the robot's URDF or MJCF, judges its joints alone (docs/import/joints.md)"
            raise SourceError(
                str(path),
                what,
                fix=fix if known is None or not known.fix else f"{fix}; {known.fix}",
            )
        super().__init__(path, settings)

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By a column that may be joint positions, in a file of a kind that is read here."""
        if not path.is_file() or any(
            (p / "meta" / "info.json").is_file() for p in path.parents[:4]
        ):
            return None
        names = _names(path)
        found = [name for name in names if may_be_joints(name)]
        if not found and path.suffix.lower() in (
            ".csv",
            ".parquet",
        ):  # its joints have names of their own
            found = [name for name in names if name.lower() in TIMES]
        return f"a column {found[0]}" if found else None

    @classmethod
    def columns_of(cls, path: Path) -> list[str]:
        """Columns as they stand."""
        return _names(path)

    @cached_property
    def _groups(self) -> list[str]:
        """HDF5: the groups of its demonstrations, or the file itself."""
        with hdf5.open_hdf5(self.path) as file, hdf5.layout(str(self.path)):
            data = file.get("data")
            names = hdf5.numbered(data) if hasattr(data, "keys") else []
            return [f"data/{name}" for name in names if hasattr(data[name], "keys")] or ["/"]

    @cached_property
    def _table(self) -> dict[str, F64]:
        """All columns of numbers of a file that is no HDF5: name → (N, k)."""
        return _read(self.path)

    def episodes(self) -> list[str]:
        """``episode_0``, …: demonstrations, or parts with the same number in a column of episodes."""
        if hdf5.is_hdf5(self.path):
            return [f"episode_{number}" for number in range(len(self._groups))]
        column = self._episode_column
        if column is None:
            return ["episode_0"]
        return [f"episode_{number:.0f}" for number in np.unique(column)]

    @property
    def _episode_column(self) -> F64 | None:
        return next((self._table[n][:, 0] for n in EPISODES if n in self._table), None)

    def _columns_of(self, name: str) -> dict[str, F64]:
        number = int(name.removeprefix("episode_"))
        if hdf5.is_hdf5(self.path):
            with hdf5.open_hdf5(self.path) as file, hdf5.layout(f"{self.path}: {name}"):
                group = file[self._groups[number]]
                found = [n for n, data in hdf5.datasets(group) if _is_table(data)]
                columns = {n: hdf5.rows(group, n, f"{self.path}: {name}") for n in found}
        else:
            column = self._episode_column
            mine = slice(None) if column is None else column == number
            columns = {n: values[mine] for n, values in self._table.items()}
        if not columns:
            raise TraceError(f"{self.path}: {name}", "has no columns of numbers")
        lengths = [len(values) for values in columns.values()]
        length = max(set(lengths), key=lengths.count)
        return {n: values for n, values in columns.items() if len(values) == length}

    @cached_property
    def _together(self) -> dict[str, tuple[str, ...]]:
        """Columns that are made of others, of one number each."""
        first = self._columns_of(self.episodes()[0])
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
        first = self._columns_of(self.episodes()[0])
        return self._together | {n: [""] * v.shape[1] for n, v in first.items()}

    def seen(self) -> list[str]:
        """All columns."""
        return _names(self.path)

    def publisher(self) -> str:
        """Nothing more than the path says it."""
        return ""

    def rows(self, name: str, wanted: Sequence[str]) -> Rows:
        """See ``ColumnImporter.rows``."""
        single = self._columns_of(name)
        columns = dict(single)
        for stem, names in self._together.items():
            if all(part in single for part in names):
                columns[stem] = np.concatenate([single[part] for part in names], axis=1)
        missing = [column for column in wanted if column not in columns]
        if missing:
            raise no_column(self._map_path, missing[0], f"column of {self.path.name}", columns)
        t = None
        for column, values in single.items():
            by = TIMES.get(column.rpartition("/")[2].rpartition(".")[2].lower())
            if by is not None and values.shape[1] == 1:
                t = by * (values[:, 0] - values[0, 0])
                break
        kept = {n: columns[n] for n in wanted}
        number = int(name.removeprefix("episode_"))
        return Rows(kept, number, t, None, tuple(self._together.get(self.joint_source, ())))


def _is_table(data: Any) -> bool:
    return data.ndim in (1, 2) and data.dtype.kind in "fiub" and data.shape[0] > 1


def _names(path: Path) -> list[str]:
    """Names of the columns of a file that is read here; none of another."""
    if hdf5.is_hdf5(path):
        with hdf5.open_hdf5(path) as file, hdf5.layout(str(path)):
            data = file.get("data")
            demos = [data[n] for n in hdf5.numbered(data)] if hasattr(data, "keys") else []
            demos = [demo for demo in demos if hasattr(demo, "keys")]
            if any("states" in demo for demo in demos):
                return []
            return [n for n, item in hdf5.datasets(demos[0] if demos else file) if _is_table(item)]
    if path.suffix.lower() == ".npz":
        return sorted(npz_names(path))
    single: list[str] = []
    if path.suffix.lower() == ".csv":
        try:
            with path.open(encoding="utf-8") as stream:
                head = stream.readline(1 << 16)
        except (OSError, UnicodeDecodeError):
            return []
        single = [word.strip().strip('"') for word in head.split(",")]
    elif path.suffix.lower() == ".parquet":
        import pyarrow.parquet as pq

        try:
            single = pq.read_schema(path).names
        except (OSError, ValueError):
            return []
    return [*grouped(single), *single]


def _read(path: Path) -> dict[str, F64]:
    """Raises TraceError for what cannot be read."""
    readers: dict[str, Callable[[Path], dict[str, Any]]] = {
        ".csv": _csv, ".parquet": _parquet, ".npz": lambda p: dict(npz_arrays(p, npz_names(p))),
    }  # fmt: skip
    try:
        columns = readers[path.suffix.lower()](path)
    except InputError:
        raise
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        raise TraceError(str(path), f"cannot be read: {str(error).splitlines()[0]}") from None
    out = {}
    for name, values in columns.items():
        try:
            array = np.asarray(values, np.float64)
        except (ValueError, TypeError):
            continue  # text, or rows of different lengths
        if array.ndim in (1, 2) and len(array) > 1:
            out[name] = array.reshape(len(array), -1)
    return out


def _csv(path: Path) -> dict[str, Any]:
    from pyarrow import csv

    current().demand_decoded(path.stat().st_size, path.stat().st_size, str(path))
    table = csv.read_csv(path)
    return {name.strip(): table[name].to_pylist() for name in table.column_names}


def _parquet(path: Path) -> dict[str, Any]:
    import pyarrow.parquet as pq

    file = pq.ParquetFile(path)
    groups = [file.metadata.row_group(n) for n in range(file.metadata.num_row_groups)]
    values = sum(g.column(i).num_values for g in groups for i in range(g.num_columns))
    current().demand_decoded(8 * values, path.stat().st_size, str(path))
    table = file.read()
    return {name: table[name].to_pylist() for name in table.column_names}


IMPORTER = JointTable
