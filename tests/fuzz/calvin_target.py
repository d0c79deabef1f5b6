"""Hostile frames of CALVIN: damaged archives, other arrays in them, and lists of episodes that are none."""

from __future__ import annotations

from pathlib import Path
from random import Random
from typing import Any

import numpy as np
from import_target import Import
from strange import NUMBERS

from safestage_eval.importers import Settings
from safestage_eval.importers.calvin import IDS
from safestage_eval.importers.map_file import load_map

FRAMES = 24
TABLE = """<robot name="t"><link name="base_link"><collision><origin xyz="0 0 0.5"/>
<geometry><box size="1 1 0.1"/></geometry></collision></link>
<link name="drawer_link"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
<joint name="base__drawer" type="prismatic"><parent link="base_link"/><child link="drawer_link"/>
<origin xyz="0.225 0 0.4"/><axis xyz="0 -1 0"/><limit lower="0" upper="0.275"/></joint></robot>"""


class Calvin(Import):
    """A file for each frame."""

    name = "CALVIN"
    read_by = ("numpy",)

    def write(self, folder: Path) -> tuple[Path, str]:
        """A block that is pushed over the furniture."""
        data = self.folder / "data"
        data.mkdir()
        (data / "calvin_table_A.urdf").write_text(TABLE)
        source = folder / "validation"
        source.mkdir(parents=True)
        for number in range(FRAMES):
            np.savez_compressed(source / f"episode_{number:07d}.npz", **_frame(number))
        np.save(source / IDS, np.array([[0, FRAMES - 1]]))
        return source, ""

    def said(self) -> str:
        """The scene, and which block it is about."""
        return '[source]\nscene = "A"\n[every.roles]\ntarget = ["block_pink"]\n'

    def told(self, path: Path) -> Settings:
        """With the furniture's description."""
        return Settings(map=load_map(path), assets=(self.folder / "data",))

    def hurt(self, rng: Random, path: Path) -> tuple[str, bool]:
        """Damage to a file, other arrays in a frame, frames that are gone, or another list."""
        source = path / "validation"
        kind = rng.random()
        if kind < 0.3:
            return super().hurt(rng, path)
        if kind < 0.75:
            return _other_arrays(rng, source)
        if kind < 0.85:
            number = rng.randrange(FRAMES)
            (source / f"episode_{number:07d}.npz").unlink()
            return f"frame {number} gone", True
        ids = rng.choice(_LISTS)
        np.save(source / IDS, ids)
        return f"{IDS}: {str(ids)[:60]}", False


def _frame(number: int) -> dict[str, Any]:
    """Three blocks on the furniture, of which the first is pushed, and an arm above them."""
    scene, robot = np.zeros(24), np.zeros(15)
    for block in range(3):
        scene[6 + 6 * block : 12 + 6 * block] = [0.2 * block, 0, 0.57, 0, 0, 0.3 * block]
    scene[6] += 0.002 * number
    robot[:3], robot[6], robot[7:14] = (0.1, 0, 0.8), 0.04, 0.01 * number
    return {"scene_obs": scene, "robot_obs": robot, "actions": np.zeros(7)}


def _other_arrays(rng: Random, source: Path) -> tuple[str, bool]:
    """Another array in one frame, or in all."""
    key = rng.choice(("scene_obs", "robot_obs", "actions"))
    numbers = rng.choice(([rng.randrange(FRAMES)], range(FRAMES)))
    place, value = rng.randrange(24), rng.choice(NUMBERS)
    act = rng.choice(("value", "value", "value", "gone", "shape", "kind", "large"))
    for number in numbers:
        arrays = _frame(number)
        if act == "value":
            with np.errstate(all="ignore"):
                arrays[key][place % len(arrays[key])] = value
        elif act == "gone":
            del arrays[key]
        elif act == "shape":
            shapes = ((), (0,), (1, 24), (23,), (25,), (24, 24), (48,))
            arrays[key] = np.resize(arrays[key], shapes[place % len(shapes)])
        elif act == "kind":
            kinds = ("U8", "S8", "c16", "?", "f2", "i8", "V8", "M8[s]", "O")
            with np.errstate(all="ignore"):
                arrays[key] = arrays[key].astype(kinds[place % len(kinds)])
        else:
            arrays[key] = np.zeros(rng.choice((10**5, 10**6)))
        np.savez_compressed(source / f"episode_{number:07d}.npz", **arrays)
        if act == "large":
            break
    lost = act == "gone" or (act == "value" and not np.isfinite(float(value)))
    return f"{key} {act} {place} {value} in {len(numbers)}", lost


_LISTS: tuple[Any, ...] = (
    np.zeros((0, 2), int), np.zeros(0), np.array(5), np.arange(3), np.array([[FRAMES - 1, 0]]),
    np.array([[-5, 3]]), np.array([[0, 10**9]]), np.array([[0, 2**62]]), np.array([[0, 3], [2, 9]]),
    np.array([[0, FRAMES]]), np.array([[0, FRAMES - 2]]), np.array([[0, FRAMES - 1]] * 2),
    np.array([[0.0, FRAMES - 1]]), np.array([[0, np.nan]]), np.array(["0", "23"]), np.array([[1j, 2]]),
    np.array([0, FRAMES - 1], np.uint8), np.array([0, 2**64 - 1], np.uint64), np.zeros(2, "V8"),
    np.arange(100_000),
)  # fmt: skip

TARGETS = {"calvin": Calvin}
