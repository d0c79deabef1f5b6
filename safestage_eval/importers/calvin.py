"""CALVIN's datasets: a folder of ``episode_*.npz``, a file for each frame, and ``ep_start_end_ids.npy``.

Facts that matter here (github.com/mees/calvin_env; calvin/dataset):

- ``scene_obs`` (24,): sliding door, drawer, button, switch (m), light bulb, green light, then position and
  roll, pitch, yaw (PyBullet, rad) of three blocks, in the order in which the scene's configuration lists them.
- ``robot_obs`` (15,): TCP position and Euler angles, opening of the gripper (m), seven joints (rad), command.
- 30 Hz; PyBullet steps at 240 Hz. Furniture and blocks are loaded at 0.8 of their size, the arm is not.
- Blocks are boxes of 1 kg: 5, 7 or 10 cm by 5 by 5 cm before scaling. Contacts are not recorded.
"""

from __future__ import annotations

from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Body, Episode, Geom, Source, still_track
from safestage_eval.errors import InputError

from .account import Account
from .foreign_motion import make_track
from .importer import Importer, Settings, SourceError
from .missing_data import say_success
from .npz_arrays import npy_array, npz_arrays
from .robot_file import robot_from_urdf
from .robot_model import scaled
from .scene_builder import SceneBuilder

F64 = NDArray[np.float64]

WIDTHS = {"scene_obs": 24, "robot_obs": 15, "actions": 7}
"""Numbers in a frame; actions may be missing."""
LENGTHS = {"small": 0.05, "middle": 0.07, "big": 0.10}
BLOCKS = {
    "A": (("block_pink", "small"), ("block_blue", "big"), ("block_red", "middle")),
    "B": (("block_red", "small"), ("block_blue", "big"), ("block_pink", "middle")),
    "C": (("block_blue", "small"), ("block_red", "big"), ("block_pink", "middle")),
    "D": (("block_red", "middle"), ("block_blue", "small"), ("block_pink", "big")),
}
"""Scene → its blocks in the order of ``scene_obs``, each with its size (conf/scene/calvin_scene_*.yaml)."""
SCALE = 0.8
BASE = (-0.34, -0.46, 0.24)
"""m, of the arm."""
FURNITURE = ("base__slide", "base__drawer", "base__button", "base__switch")
RATE, PHYSICS = 30.0, 240.0
LONGEST = 20_000
"""Frames of an episode at the most."""


class Calvin(Importer):
    """A folder of frames, ``training`` or ``validation``."""

    name = "calvin"
    title = "CALVIN frames (episode_*.npz)"

    def __init__(self, path: Path, settings: Settings) -> None:
        """Read which frames make up which episode; raise InputError where they are damaged."""
        super().__init__(path, settings)
        ids = npy_array(path / IDS)
        pairs = (
            ids.astype(np.int64).reshape(-1, 2)
            if ids.dtype.kind in "iu" and not ids.size % 2
            else ()
        )
        if not len(pairs) or any(not 0 <= a <= b for a, b in pairs):
            raise InputError(
                f"{path}/{IDS}", f"holds {ids.shape} {ids.dtype}, not the frames of episodes.",
                "two integers for each episode: the numbers of its first and its last frame",
            )  # fmt: skip
        self._spans = {f"episode_{a:07d}_{b:07d}": (int(a), int(b)) for a, b in pairs}

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By ``ep_start_end_ids.npy`` beside frames."""
        there = path.is_dir() and (path / IDS).is_file()
        return f"{IDS} and episode_*.npz" if there and any(path.glob("episode_*.npz")) else None

    def episodes(self) -> Sequence[str]:
        """``episode_0000000_0001234``: first and last frame."""
        return list(self._spans)

    def fingerprint(self, name: str) -> str:
        """Digest of the first and last frame's observations."""
        first, last = self._spans[name]
        digest = sha256(name.encode())
        for frame in (first, last):
            digest.update(self._frame(frame)["scene_obs"].tobytes())
        return digest.hexdigest()[:16]

    def read(self, name: str, account: Account) -> Episode:
        """Read one stretch of play."""
        first, last = self._spans[name]
        if last - first >= LONGEST:
            raise SourceError(
                f"{self.path}: {name}", f"has {last - first + 1} frames.", f"{LONGEST:,}"
            )
        frames = [self._frame(i) for i in range(first, last + 1)]
        scene_obs = np.stack([frame["scene_obs"] for frame in frames])
        robot_obs = np.stack([frame["robot_obs"] for frame in frames])
        scene = SceneBuilder(self.settings, str(self.path), account)
        which = scene.ask(self._scene, "D")
        _blocks(which, scene_obs, scene)
        scene.ask(lambda: self._table(which, scene_obs, scene), None)
        scene.refuse()
        _robot(robot_obs, frames, scene)
        say_success(account, known=False, hold=None)
        dt = self.settings.stated_dt or 1 / RATE
        return scene.episode(
            np.arange(len(frames), dtype=np.float64) * dt, com="the middles of the blocks",
            physics_dt=self.settings.map.source.physics_dt or 1 / PHYSICS, frame_dt=dt, control_dt=dt,
            source=Source(simulator="PyBullet (CALVIN)"),
        )  # fmt: skip

    def _frame(self, number: int) -> dict[str, F64]:
        path = self.path / f"episode_{number:07d}.npz"
        frame = npz_arrays(path, WIDTHS)
        for key, width in WIDTHS.items():
            array = frame.get(key)
            if array is None and key == "actions":
                continue
            if array is None or array.shape != (width,) or array.dtype.kind not in "iuf":
                actual = "no such array" if array is None else f"{array.shape} {array.dtype}"
                raise SourceError(
                    str(path), f"{key}: {actual}.", f"({width},) numbers, with Euler angles"
                )
            if not np.isfinite(array).all():
                raise SourceError(str(path), f"{key} is not finite throughout.", "numbers")
        return {key: values.astype(np.float64) for key, values in frame.items()}

    def _scene(self) -> str:
        if self.settings.map.source.scene is None:
            raise SourceError(
                str(self.path), "which of CALVIN's scenes it shows is not recorded in its frames.",
                ", ".join(BLOCKS), '[source] scene = "D" in the map file, or under [in."GLOB".source]',
            )  # fmt: skip
        return self.settings.map.source.scene

    def _table(self, which: str, obs: F64, scene: SceneBuilder) -> None:
        """The furniture by its URDF, its drawer and door by their joints."""
        name = f"calvin_table_{which}.urdf"
        files = [file for folder in self.settings.assets for file in sorted(folder.rglob(name))]
        if not files:
            raise SourceError(
                str(self.path), f"its furniture is described by {name}, which it does not bring.",
                fix="--assets DIR, the folder calvin_env/data of CALVIN's simulator",
            )  # fmt: skip
        folders = (files[0].parent, files[0].parent.parent)
        text = files[0].read_text("utf-8", errors="replace")
        model = scaled(robot_from_urdf(text, str(files[0]), folders, hollow=True), SCALE)
        known = {joint.name for joint in model.joints}
        positions = {joint: obs[:, i] for i, joint in enumerate(FURNITURE) if joint in known}
        base = np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]])
        scene.meshes.update(model.meshes)
        for link, (place, turn) in zip(
            model.links, model.place(base, positions).values(), strict=True
        ):
            parent = link.body.parent and f"table_{link.body.parent}"
            raw = link.body.model_copy(
                update={"name": f"table_{link.body.name}", "kind": "fixture", "parent": parent,
                        "finger": None, "untold": ("cavity",)}
            )  # fmt: skip
            where, how = (
                np.broadcast_to(part, (len(obs), part.shape[-1])) for part in (place, turn)
            )
            scene.add(scene.describe(raw), make_track(where, how, None, None))
        scene.account.recomputed(
            "poses of drawer, door, button and switch", f"from their joints, by {name}"
        )


def _blocks(which: str, obs: F64, scene: SceneBuilder) -> None:
    from scipy.spatial.transform import Rotation

    for i, (name, size) in enumerate(BLOCKS[which]):
        pose = obs[:, 6 + 6 * i : 12 + 6 * i]
        x, y, z, w = Rotation.from_euler("xyz", pose[:, 3:]).as_quat().T
        half = (SCALE * LENGTHS[size] / 2, SCALE * 0.025, SCALE * 0.025)
        raw = Body(
            name=name, kind="object", mass=1.0, geoms=(Geom(kind="box", size=half),),
            untold=("up_axis", "cavity"),
        )  # fmt: skip
        turn = np.column_stack([w, x, y, z])
        scene.add(scene.describe(raw), make_track(pose[:, :3], turn, None, None))
    scene.account.guessed(
        "which block is which", f"{', '.join(name for name, _ in BLOCKS[which])}, as scene {which} lists them",
        cost="sizes and roles of the blocks",
    )  # fmt: skip


def _robot(obs: F64, frames: list[dict[str, F64]], scene: SceneBuilder) -> None:
    base, fingers = still_track(BASE, (1.0, 0.0, 0.0, 0.0)), obs[:, [6, 6]] / 2
    if scene.settings.robot is not None:
        scene.place_robot("robot_base", base, np.hstack([obs[:, 7:14], fingers]))
    else:
        scene.articulation("robot", base, obs[:, 7:14])
        scene.record(gripper=np.clip(obs[:, 6:7] / 0.08, 0.0, 1.0))
    if all("actions" in frame for frame in frames):
        scene.record(action=np.stack([frame["actions"] for frame in frames]))


IDS = "ep_start_end_ids.npy"

IMPORTER = Calvin
