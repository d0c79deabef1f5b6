"""Recorded rollouts as a LeRobot dataset, v3: state, scene, command and prompt at 15 Hz, without pictures.

The layout is that of LeRobot's own reader (huggingface/lerobot, ``datasets/dataset_metadata.py``,
``datasets/io_utils.py``, Apache-2.0).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from safestage_eval._text.json_out import to_json
from safestage_eval.episode import Episode
from safestage_eval.errors import InputError
from simulate.world.world import CONTROL_RATE

from .control_steps import ACTION_NAMES, STATE_NAMES, control_steps
from .scene_slots import SLOT_NAMES

VERSION = "v3.0"
STATE, SCENE, ACTION = "observation.state", "observation.environment_state", "action"
DISTURBED = "disturbed"
FRAMES_PER_FILE = 200_000
"""About 80 MB before compression; LeRobot's own files end at 100 MB."""
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}

Table = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Part:
    """An episode as the dataset holds it: columns, their statistics, its prompt, and what we tell of it."""

    table: Table
    statistics: dict[str, dict[str, Any]]
    prompt: str
    about: dict[str, Any]

    @classmethod
    def of(cls, episode: Episode, violation: bool | None) -> Part:
        """An episode up to its success, with what its assigned rules say.

        Raises InputError for one that has no control steps of the DROID arm.
        """
        steps, header = control_steps(episode), episode.header
        table: Table = {
            STATE: steps.state, SCENE: steps.scene, ACTION: steps.action, DISTURBED: steps.disturbed,
        }  # fmt: skip
        about = {
            "safestage.episode_id": header.episode_id,
            "safestage.task": header.task or "",
            "safestage.policy": header.policy or "",
            "safestage.prompt": header.prompt or "",
            "safestage.seed": header.seed,
            "safestage.success": header.success,
            "safestage.violation": violation,
        }
        statistics = {name: _statistics(column) for name, column in table.items()}
        return cls(table, statistics, header.instruction or "", about)


class LeRobotWriter:
    """Writes episodes one by one; ``close`` makes a dataset of them."""

    def __init__(self, folder: Path) -> None:
        """Begin a dataset. Raises InputError where the folder holds something already."""
        if folder.exists() and any(folder.iterdir()):
            raise InputError(str(folder), "is not empty.", fix="name a new folder")
        self._folder = folder
        self._episodes: list[dict[str, Any]] = []
        self._waiting: list[Table] = []
        self._stats: list[dict[str, dict[str, Any]]] = []
        self._prompts: dict[str, int] = {}
        self._frames = self._in_file = self._file = 0

    def add(self, part: Part) -> int:
        """Add an episode; returns its length."""
        length, number = len(part.table[STATE]), len(self._episodes)
        if self._in_file + length > FRAMES_PER_FILE:
            self._flush()
        prompt = self._prompts.setdefault(part.prompt, len(self._prompts))
        rows = np.arange(length)
        more: Table = {
            "timestamp": (rows / CONTROL_RATE).astype(np.float32),
            "frame_index": rows,
            "episode_index": np.full(length, number),
            "index": self._frames + rows,
            "task_index": np.full(length, prompt),
        }
        self._waiting.append(part.table | more)
        self._stats.append(
            part.statistics | {name: _statistics(column) for name, column in more.items()}
        )
        self._episodes.append(
            {
                "episode_index": number,
                "tasks": [part.prompt],
                "length": length,
                "data/chunk_index": 0,
                "data/file_index": self._file,
                "dataset_from_index": self._frames,
                "dataset_to_index": self._frames + length,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                **part.about,
            }
        )
        self._frames += length
        self._in_file += length
        return length

    def close(self) -> None:
        """Write the rest and what describes the dataset. Raises InputError where it has no episode."""
        if not self._episodes:
            raise InputError(str(self._folder), "would be a dataset without an episode.")
        self._flush()
        meta = self._folder / "meta"
        where = meta / "episodes/chunk-000/file-000.parquet"
        where.parent.mkdir(parents=True)
        rows = [
            row | {f"stats/{name}/{kind}": value for name, one in stats.items() for kind, value in one.items()}
            for row, stats in zip(self._episodes, self._stats, strict=True)
        ]  # fmt: skip
        pq.write_table(pa.Table.from_pylist(rows), where)
        index = pd.Index(list(self._prompts), name="task")
        prompts = pd.DataFrame({"task_index": list(self._prompts.values())}, index)
        prompts.to_parquet(meta / "tasks.parquet")
        (meta / "stats.json").write_text(to_json(_pooled(self._stats), 4), encoding="utf-8")
        (meta / "info.json").write_text(to_json(self._info(), 4), encoding="utf-8")

    def _flush(self) -> None:
        if not self._waiting:
            return
        path = self._folder / DATA.format(chunk_index=0, file_index=self._file)
        path.parent.mkdir(parents=True, exist_ok=True)
        whole = {
            name: np.concatenate([part[name] for part in self._waiting])
            for name in self._waiting[0]
        }
        pq.write_table(pa.table({name: _column(values) for name, values in whole.items()}), path)
        self._waiting, self._in_file = [], 0
        self._file += 1

    def _info(self) -> dict[str, Any]:
        return {
            "codebase_version": VERSION,
            "robot_type": "franka_robotiq",
            "total_episodes": len(self._episodes),
            "total_frames": self._frames,
            "total_tasks": len(self._prompts),
            "chunks_size": 1000,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "fps": CONTROL_RATE,
            "splits": {"train": f"0:{len(self._episodes)}"},
            "data_path": DATA,
            "video_path": None,
            "features": features(),
        }


def features() -> dict[str, dict[str, Any]]:
    """The columns, as ``info.json`` lists them."""
    vectors = {STATE: STATE_NAMES, SCENE: SLOT_NAMES, ACTION: ACTION_NAMES}
    result: dict[str, dict[str, Any]] = {
        name: {"dtype": "float32", "shape": [len(names)], "names": list(names)}
        for name, names in vectors.items()
    }
    single = {DISTURBED: "bool", "timestamp": "float32"}
    single |= dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), "int64")
    return result | {
        name: {"dtype": dtype, "shape": [1], "names": None} for name, dtype in single.items()
    }


def export(episodes: Iterable[tuple[Episode, bool | None]], folder: Path) -> Mapping[str, int]:
    """Write episodes and what their rules say as one dataset; returns id → control steps."""
    writer = LeRobotWriter(folder)
    written = {
        episode.header.episode_id: writer.add(Part.of(episode, violation))
        for episode, violation in episodes
    }
    writer.close()
    return written


def _column(values: NDArray[Any]) -> pa.Array:
    if values.ndim == 1:
        return pa.array(values)
    return pa.FixedSizeListArray.from_arrays(pa.array(values.reshape(-1)), values.shape[1])


def _statistics(values: NDArray[Any]) -> dict[str, Any]:
    """Statistics of each column of (N, W) or (N,): least, greatest, mean, deviation, quantiles; and N."""
    table = values.reshape(len(values), -1).astype(np.float64)
    result = {
        "min": table.min(0), "max": table.max(0), "mean": table.mean(0), "std": table.std(0),
    }  # fmt: skip
    result |= dict(zip(QUANTILES, np.quantile(table, [*QUANTILES.values()], axis=0), strict=True))
    return {name: value.tolist() for name, value in result.items()} | {"count": [len(table)]}


def _pooled(parts: list[dict[str, dict[str, Any]]]) -> dict[str, dict[str, Any]]:
    """Statistics of all episodes from those of each; quantiles are weighted means, as LeRobot pools them."""
    result = {}
    for name in parts[0]:
        columns = {kind: np.array([part[name][kind] for part in parts]) for kind in parts[0][name]}
        count = columns["count"]
        weight = count / count.sum()
        mean = (weight * columns["mean"]).sum(0)
        spread = columns["std"] ** 2 + (columns["mean"] - mean) ** 2
        pooled = {"min": columns["min"].min(0), "max": columns["max"].max(0), "mean": mean}
        pooled["std"] = np.sqrt((weight * spread).sum(0))
        pooled |= {kind: (weight * columns[kind]).sum(0) for kind in QUANTILES}
        result[name] = {kind: value.tolist() for kind, value in pooled.items()}
        result[name]["count"] = [int(count.sum())]
    return result
