"""LeRobot datasets, v2 and v3 (github.com/huggingface/lerobot); the map file assigns their columns."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from .column_episode import ColumnImporter, Rows
from .importer import Settings
from .lerobot_tables import OWN, Tables, described


class LeRobot(ColumnImporter):
    """One dataset folder."""

    name = "lerobot"
    title = "LeRobot v2 / v3 dataset"

    def __init__(self, path: Path, settings: Settings) -> None:
        """Read the dataset's description.

        Raises:
            SourceError: no column map, or columns that the dataset does not have.
        """
        self._info = described(path) or {}
        self._tables = Tables(path)
        features = self._info.get("features")
        self._features: dict[str, Any] = features if isinstance(features, dict) else {}
        super().__init__(path, settings)

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By ``meta/info.json`` with a ``codebase_version``."""
        info = described(path)
        if info is None or "codebase_version" not in info:
            return None
        return f"meta/info.json with codebase_version {info['codebase_version']}"

    @classmethod
    def columns_of(cls, path: Path) -> list[str]:
        """Columns of numbers, with how many each row has."""
        features = (described(path) or {}).get("features")
        table = features if isinstance(features, dict) else {}
        plain = {n: f for n, f in table.items() if n not in OWN and isinstance(f, dict)}
        return [
            f"{name}[0:{shape[0]}]" if len(shape := f.get("shape") or []) == 1 else name
            for name, f in plain.items()
            if str(f.get("dtype", "")).startswith(("float", "int", "bool"))
        ]

    def episodes(self) -> list[str]:
        """``episode_0``, ``episode_1``, … in order."""
        return [f"episode_{number}" for number in sorted(self._tables.files)]

    def seen(self) -> list[str]:
        """Columns of ``meta/info.json``, without images."""
        return [name for name in self._features if name not in OWN and "image" not in name]

    def widths(self) -> dict[str, Sequence[str]]:
        """See ``ColumnImporter.widths``."""
        shapes = {n: f.get("shape") for n, f in self._features.items() if isinstance(f, dict)}
        return {
            name: self._joints(name) or [""] * shape[0]
            for name, shape in shapes.items()
            if name not in OWN and isinstance(shape, list) and len(shape) == 1
        }

    def publisher(self) -> str:
        """The type of the robot."""
        return str(self._info.get("robot_type", ""))

    def rows(self, name: str, wanted: Sequence[str]) -> Rows:
        """See ``ColumnImporter.rows``."""
        number = int(name.removeprefix("episode_"))
        columns = self._tables.read(number, wanted, self._map_path)
        count, fps = len(next(iter(columns.values()))), self._info.get("fps")
        t = None
        if "timestamp" in columns:
            t = columns["timestamp"][:, 0] - columns["timestamp"][0, 0]
        elif isinstance(fps, int | float) and fps > 0:
            t = np.arange(count, dtype=np.float64) / float(fps)
        task = columns.get("task_index")
        instruction = None if task is None else self._tables.tasks.get(int(task[0, 0]))
        return Rows(columns, number, t, instruction, self._joints(self.joint_source))

    def _joints(self, column: str) -> tuple[str, ...]:
        """Names of the numbers in a column."""
        feature = self._features.get(column, {})
        names = feature.get("names") if isinstance(feature, dict) else None
        names = next(iter(names.values()), None) if isinstance(names, dict) else names
        if not isinstance(names, list):
            return ()
        return tuple(str(name) for name in names)


IMPORTER = LeRobot
