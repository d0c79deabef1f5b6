"""Pictures of recorded rollouts, drawn afterwards from their states; no physics is done again."""

from __future__ import annotations

import json
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.errors import InputError
from safestage_eval.formats import EpisodeRef
from simulate.cameras.droid_cameras import Cameras
from simulate.looks.room import look_numbers
from simulate.tasks.task import Task, tasks
from simulate.world.world import World

from .control_steps import control_rows
from .picture_recipe import CAMERAS, EVERY, SIZE, U8, stacked

Scene = tuple[str, int]
"""Task and environment seed: what looks the same."""


@dataclass(frozen=True)
class Drawn:
    """Pictures of a folder, and where each episode's are.

    Attributes:
        files: pictures (N, CAMERAS, 3, height, width) uint8, mapped from disk, one array per scene.
        rows: episode id → (N,) index over all files in a row, of control steps 0, EVERY, 2 EVERY, …
    """

    files: tuple[U8, ...]
    rows: Mapping[str, NDArray[np.int64]]


def scenes_of(refs: Sequence[EpisodeRef]) -> list[tuple[Scene, list[EpisodeRef]]]:
    """Recordings by what looks the same, all tasks of a seed before those of the next."""
    scenes: defaultdict[Scene, list[EpisodeRef]] = defaultdict(list)
    for ref in refs:
        scenes[str(ref.fields.get("task")), int(ref.fields.get("seed") or 0)].append(ref)
    return sorted(scenes.items(), key=lambda item: (item[0][1], item[0][0]))


def draw_scene(scene: tuple[Scene, list[EpisodeRef]], out: Path, until: float | None = None) -> str:
    """Draw what the cameras saw in the recordings of a scene; returns what went wrong, in words.

    A scene whose file is there is left as it is, so that drawing can be taken up again. After
    ``until`` (s, as ``time.time``) nothing is drawn.
    """
    (task, seed), refs = scene
    about = out / f"{task}.s{seed}.json"
    if about.exists():
        return ""
    if until is not None and time.time() > until:
        return f"{about.stem}: not drawn, the time was over"
    try:
        pictures, counts = _pictures(tasks()[task], seed, refs)
    except (InputError, KeyError) as error:
        return f"{about.stem}: {error}"
    out.mkdir(parents=True, exist_ok=True)
    part = about.with_suffix(".part")
    with part.open("wb") as file:
        np.save(file, pictures)
    part.replace(about.with_suffix(".npy"))
    about.write_text(json.dumps(counts), encoding="utf-8")  # last: it says that the rest is whole
    return ""


def read_pictures(folder: Path) -> Drawn:
    """Pictures of a folder. Raises InputError where there are none."""
    files, rows, first = [], {}, 0
    for about in sorted(folder.glob("*.json")):
        pictures = np.load(about.with_suffix(".npy"), mmap_mode="r")
        for name, count in json.loads(about.read_text(encoding="utf-8")).items():
            rows[name] = np.arange(first, first + count)
            first += count
        files.append(pictures)
    if not files:
        raise InputError(str(folder), "has no pictures.", fix="safestage bench learn pictures")
    return Drawn(tuple(files), rows)


def states(world: World, episode: Episode, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """(N, nq) joint positions of the world at frames of an episode recorded in it.

    With four physics steps a frame, this is three of them (6 ms) after what a policy was given.
    """
    model = world.model
    result = np.tile(world.data.qpos, (len(rows), 1))
    hinges = np.flatnonzero(model.jnt_type >= int(mujoco.mjtJoint.mjJNT_SLIDE))
    result[:, model.jnt_qposadr[hinges]] = episode.frames.joint_position[rows]
    for name, thing in world.objects.items():
        if not thing.fixed:
            at, track = model.joint(f"{name}/free").qposadr[0], episode.track(name)
            result[:, at : at + 3] = track.position[rows]
            result[:, at + 3 : at + 7] = track.orientation[rows]
    return result


def _pictures(task: Task, seed: int, refs: Sequence[EpisodeRef]) -> tuple[U8, dict[str, int]]:
    world = World(task.models(), substeps=task.substeps, look=look_numbers(task.id, seed))
    world.reset(task.layout(seed))
    cameras = Cameras(world, CAMERAS, SIZE)
    drawn: list[U8] = []
    counts: dict[str, int] = {}
    try:
        for ref in refs:
            episode = ref.open()
            found = states(world, episode, control_rows(episode)[::EVERY])
            for state in found:
                world.data.qpos[:] = state
                drawn.append(stacked(cameras.images()))
            counts[ref.episode_id or ""] = len(found)
    finally:
        cameras.close()
    return np.stack(drawn), counts
