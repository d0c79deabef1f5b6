"""A LeRobot dataset that this package wrote, as arrays to train on."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from numpy.typing import NDArray

from safestage_eval.errors import InputError
from simulate.arm.kinematics import ArmAlone
from simulate.tasks.task import tasks

from .lerobot_writer import ACTION, DISTURBED, SCENE, STATE
from .policy_inputs import arm_rows, object_rows
from .prompt_embedding import embedded

F32 = NDArray[np.float32]
I64 = NDArray[np.int64]


@dataclass(frozen=True)
class TrainingData:
    """Control steps of all episodes, one after another.

    Attributes:
        arm: (N, 10) measured; see ``policy_inputs``.
        objects: (N, SLOTS, 10).
        target: (N, 10) what the command brings the TCP to, and 1 to close, −1 to open.
        first: (N,) row of the episode's first control step.
        until: (N,) row before which answers are recorded: the episode's end, or the next disturbance.
        end: (N,) row after the episode's last control step. Where ``until`` is ``end``, what follows is
            known too: the last command again.
        prompts: (P, WIDTH) embeddings.
        spoken: (N, 3) index of the prompt in each condition: default, generic, specific; −1 where
            this way was not shown under it.
        usable: rows that may be learned from.
    """

    arm: F32
    objects: F32
    target: F32
    first: I64
    until: I64
    end: I64
    prompts: F32
    spoken: I64
    usable: I64


def read_dataset(folders: list[Path]) -> TrainingData:
    """Read datasets of ``safestage bench learn export``.

    Default and generic prompts are paired with every way, the specific prompt with safe ways only.
    Episodes without success, or with an open verdict, are left out.

    Raises InputError for a folder that is no such dataset, or one without usable episodes.
    """
    arm, parts = ArmAlone(), []
    prompts: dict[str, int] = {}
    for folder in folders:
        meta, data = _tables(folder)
        for row in meta:
            if row["safestage.success"] is False or row["safestage.violation"] is None:
                continue
            task = tasks().get(row["safestage.task"])
            if task is None:
                continue
            span = slice(row["dataset_from_index"], row["dataset_to_index"])
            said = task.prompts.model_dump()
            conditions = [said["default"], said["generic"]]
            conditions += [] if row["safestage.violation"] else [said["specific"]]
            index = [prompts.setdefault(text, len(prompts)) for text in conditions]
            parts.append(_episode(arm, {k: v[span] for k, v in data.items()}, [*index, -1][:3]))
    if not parts:
        raise InputError(", ".join(map(str, folders)), "no episode with success and a verdict.")
    lengths = np.array([len(part["arm"]) for part in parts])
    starts = np.repeat(np.cumsum(lengths) - lengths, lengths)
    whole = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    usable = np.flatnonzero(~whole.pop("disturbed"))
    whole["until"] += starts
    return TrainingData(
        **whole,
        first=starts,
        end=starts + np.repeat(lengths, lengths),
        prompts=np.array([embedded(prompt) for prompt in prompts]),
        usable=usable,
    )


def _tables(folder: Path) -> tuple[list[dict[str, Any]], dict[str, NDArray[Any]]]:
    try:
        info = json.loads((folder / "meta/info.json").read_text(encoding="utf-8"))
        files = sorted(folder.glob("data/*/*.parquet"))
        table = pq.read_table(files, columns=[STATE, SCENE, ACTION, DISTURBED])
        meta = pq.read_table(sorted(folder.glob("meta/episodes/*/*.parquet"))).to_pylist()
        columns = {
            name: table[name].combine_chunks().flatten().to_numpy().reshape(
                -1, info["features"][name]["shape"][0]
            )
            for name in (STATE, SCENE, ACTION)
        }  # fmt: skip
        columns[DISTURBED] = table[DISTURBED].to_numpy()
        if meta and "safestage.violation" not in meta[0]:
            raise KeyError("safestage.violation")
    except (OSError, ValueError, KeyError) as error:
        raise InputError(
            str(folder), f"no dataset of `safestage bench learn export`: {error}"
        ) from None
    return meta, columns


def _episode(
    arm: ArmAlone, data: dict[str, NDArray[Any]], spoken: list[int]
) -> dict[str, NDArray[Any]]:
    length, disturbed = len(data[ACTION]), data[DISTURBED].astype(bool)
    until = np.full(length, length)
    for row in range(length - 2, -1, -1):
        until[row] = row + 1 if disturbed[row + 1] else until[row + 1]
    state, action = data[STATE], data[ACTION]
    return {
        "arm": arm_rows(arm, state[:, :7], state[:, 7]),
        "objects": object_rows(data[SCENE]),
        "target": arm_rows(arm, action[:, :7], np.where(action[:, 7] > 0.5, 1.0, -1.0)),
        "until": until,
        "spoken": np.tile(np.array(spoken, np.int64), (length, 1)),
        "disturbed": disturbed,
    }
