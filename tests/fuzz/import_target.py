"""Hostile recordings of others: HDF5 and LeRobot, and what the other imports share.

A file without checksums that says something else is another sound source. Damage, whose verdicts are
compared with the sound source's, is what is gone, cut off or no number any more, and whatever happens to bytes
that have a checksum.
"""

from __future__ import annotations

import re
import shutil
from abc import ABC, abstractmethod
from functools import cache
from pathlib import Path
from random import Random

import h5py
import numpy as np
from damage import damaged
from exports import map_text, write_lerobot, write_maniskill, write_robolab
from oracle import Sound, judged, sound
from outcome import Outcome
from seeds import recorded
from strange import NAMES, NUMBERS

from safestage_eval.episode import Body, Episode, RobotFrames
from safestage_eval.errors import InputError
from safestage_eval.formats import discover, validate
from safestage_eval.importers import Settings, import_all, load_map
from safestage_eval.rules import load_rules

TAKEN = {"table": "table", "dumbbell": "cube", "glasses": "glasses", "robot_base": "hand"}
"""Bodies of the recorded episode that others' layouts are given, and their names there."""


@cache
def episode() -> Episode:
    """Three objects of a recorded episode and a hand without shape, as far as others' layouts go."""
    whole = recorded()[0]
    bodies, tracks = [], {}
    for body in whole.header.bodies:
        if body.name in TAKEN:
            name = TAKEN[body.name]
            bodies.append(body.model_copy(update={"name": name, "parent": None, "excluded": ()}))
            tracks[name] = whole.tracks[body.name]
    bodies = [Body(name="hand", kind="gripper") if b.name == "hand" else b for b in bodies]
    values = {
        "bodies": tuple(bodies), "joints": (), "roles": {"target": ("cube",)}, "rules": (),
        "task": "Push", "goal": None, "parameters": {}, "success": False, "success_time": None,
        "force_source": "none", "cameras": (), "physics_dt": whole.header.frame_dt / 8,
    }  # fmt: skip
    header = whole.header.model_copy(update=values)
    return Episode(header, whole.t, tracks, None, RobotFrames.empty(len(whole)))


class Import(ABC):
    """A source with one of its files damaged; what is imported must be sound."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.seed = folder, folder / "seed"
        self.source, columns = self.write(self.seed)
        text = self.said() + columns
        (folder / "map.toml").write_text(text)
        self.settings = self.told(folder / "map.toml")
        imported = import_all(self.seed, folder / "sound", self.settings)
        assert imported.imported, imported.failed
        assert not imported.failed
        self.rules = load_rules([Path(__file__).with_name("imports.toml")])
        self.wholes = [sound(ref, self.rules) for ref in discover(folder / "sound")]
        for other in self.wholes[1:]:
            assert other.verdicts == self.wholes[0].verdicts

    def said(self) -> str:
        """The map file without columns."""
        return map_text(episode())

    def told(self, path: Path) -> Settings:
        """The user's settings, by the path of the map file."""
        return Settings(map=load_map(path))

    @abstractmethod
    def write(self, folder: Path) -> tuple[Path, str]:
        """The sound source, and what else its map file says."""

    def run(self, rng: Random) -> Outcome:
        """One input."""
        path = self.folder / "input"
        for old in (path, self.folder / "out"):
            shutil.rmtree(old, ignore_errors=True)
        shutil.copytree(self.seed, path)
        source = self.chosen(rng, path)
        what, is_damage = self.hurt(rng, path)
        try:
            outcome = import_all(source, self.folder / "out", self.settings)
        except InputError as error:
            return Outcome("problem", what, str(error)[:300])
        for failed in outcome.failed:
            kind = "unforeseen" if "bug in the" in failed.message else "problem"
            return Outcome(kind, what, failed.message[:300])
        if rng.random() < 0.2 and (problems := validate(self.folder / "out")):
            return Outcome("changed", what, f"imported, and broken: {problems[0]}")
        return judged(self.folder / "out", self.whole(), what, self.rules, damage=is_damage)

    def whole(self) -> Sound:
        """The episode that the sound source is imported as."""
        return self.wholes[0]

    def chosen(self, rng: Random, path: Path) -> Path:
        """The episode imported from a copy of the seed."""
        return path / self.source.relative_to(self.seed)

    def hurt(self, rng: Random, path: Path) -> tuple[str, bool]:
        """Damage to the source; what was done, and whether it is damage."""
        files = sorted(file for file in path.rglob("*") if file.is_file())
        numbers = [file for file in files if file.suffix in (".hdf5", ".h5", ".parquet")]
        file = rng.choice(numbers if numbers and rng.random() < 0.5 else files)
        if file.suffix in (".hdf5", ".h5") and rng.random() < 0.6:
            return _in_hdf5(rng, file)
        data, what = damaged(rng, file.read_bytes(), [0, 8, 16, 24, 48, 96])
        file.write_bytes(data)
        lost = what.startswith(("cut", "headless"))
        checked = file.suffix in (".npz", ".gz") or ".tfrecord" in file.name
        return f"{file.name}: {what}", lost or checked


class RoboLab(Import):
    """Isaac Lab's HDF5 with its neighbours."""

    name = "RoboLab and Isaac Lab HDF5"
    read_by = ("h5py",)

    def write(self, folder: Path) -> tuple[Path, str]:
        """One demonstration."""
        return write_robolab(folder, [episode()]), ""


class ManiSkill(Import):
    """HDF5 with a JSON file."""

    name = "ManiSkill"
    read_by = ("h5py",)

    def write(self, folder: Path) -> tuple[Path, str]:
        """One trajectory."""
        return write_maniskill(folder, episode()), ""


class LeRobot(Import):
    """Parquet and JSON."""

    name = "LeRobot"
    read_by = ("pyarrow",)

    def write(self, folder: Path) -> tuple[Path, str]:
        """One episode."""
        return write_lerobot(folder / "set", [episode()])


NO_DAMAGE = ("attribute", "name")
"""Acts on a tree after which it is another one."""

ACTOR = re.compile(r"traj_0/env_states/(actors|articulations)/\w+")
"""Bodies that ManiSkill's file mentions nowhere else: without them it is a scene of fewer bodies."""


def _in_hdf5(rng: Random, path: Path) -> tuple[str, bool]:
    """Something in the file's tree."""
    with h5py.File(path, "a") as file:
        names: list[str] = []
        file.visititems(lambda name, item: names.append(name))
        name = rng.choice(names)
        parent = file[name].parent
        act = rng.choice(
            ("gone", "numbers", "text", "shape", "link", "outside", "numbers outside", "circle",
             "huge", "attribute", "name", "dtype")
        )  # fmt: skip
        try:
            is_damage = _act(rng, file, name, parent, act)
        except (ValueError, OSError, RuntimeError, TypeError, KeyError, OverflowError) as error:
            return f"{name} {act}: {error}", False
    return f"{name} {act}", is_damage


def _act(rng: Random, file: h5py.File, name: str, parent: h5py.Group, act: str) -> bool:
    item = file[name]
    if act == "numbers" and isinstance(item, h5py.Dataset) and item.size:
        values = item[()]
        with np.errstate(all="ignore"):
            values.flat[rng.randrange(values.size)] = rng.choice(NUMBERS)
        item[...] = values
        return values.dtype.kind == "f" and not np.isfinite(values).all()
    if act == "shape" and isinstance(item, h5py.Dataset):
        values = np.resize(item[()], rng.choice(((0,), (3,), (8, 1), (8, 100), (1, 1, 1, 7))))
        del file[name]
        file[name] = values
    elif act == "attribute":
        owner = rng.choice([file, item, parent])
        key = rng.choice([*owner.attrs, "x"])
        owner.attrs[key] = rng.choice(
            (*[n for n in NAMES if "\0" not in n], -1, 1e300, [1, 2], b"\xff")
        )
    elif act == "name":
        file.move(name, f"{name}{rng.choice(('x', '_0', ' ', 'é'))}")
    else:
        del file[name]
        if act == "text":
            file[name] = "none"
        elif act == "dtype":
            file[name] = np.zeros(8, [("a", "f4"), ("b", "i8")])
        elif act == "link":
            file[name] = h5py.SoftLink(rng.choice(("/nowhere", "/", f"/{name}")))
        elif act == "outside":
            file[name] = h5py.ExternalLink("/etc/passwd", "/")
        elif act == "numbers outside":
            file.create_dataset(name, (8, 7), "f4", external=[("/etc/passwd", 0, 224)])
        elif act == "circle":
            file[name] = parent
        elif act == "huge":
            file.create_dataset(name, (2**40, 7), "f4", chunks=(1024, 7))
    left_out = ACTOR.fullmatch(name) and name not in file
    return act not in NO_DAMAGE and not left_out


TARGETS = {"robolab": RoboLab, "maniskill": ManiSkill, "lerobot": LeRobot}
