"""Hostile recordings of MuJoCo states, in the layouts of robosuite and RoboCasa."""

from __future__ import annotations

import gzip
import json
import xml.etree.ElementTree as ET
from pathlib import Path
from random import Random

import h5py
import numpy as np
from damage import damaged
from foreign_demos import demo_file, scene, settled
from import_target import Import
from oracle import Sound
from strange import NAMES, NUMBERS

BODIES = """
<body name="robot0_base" pos="0.4 0 0.1">
  <geom type="capsule" size="0.03 0.05" mass="1"/>
  <body name="robot0_link" pos="0 0 0.1"><joint name="robot0_joint1" type="hinge" axis="0 1 0"/>
    <geom name="finger" type="box" size="0.01 0.01 0.03" mass="0.1"/></body>
</body>
<body name="bin" pos="-0.4 0 0"><geom type="box" size="0.1 0.1 0.01"/>
  <geom type="ellipsoid" size="0.02 0.03 0.04" pos="0 0 0.1"/></body>
"""
REST = """
<asset><mesh name="hull" vertex="0 0 0 0.1 0 0 0 0.1 0 0 0 0.1"/></asset>
<actuator><motor joint="robot0_joint1"/></actuator>
<contact><exclude body1="robot0_base" body2="bin"/></contact>
<equality><weld body1="cube" body2="bin" active="false"/></equality>
"""
TAGS = ("body", "geom", "joint", "freejoint", "mesh", "hfield", "plugin", "flexcomp", "replicate",
        "composite", "include", "frame", "skin", "tendon", "site", "light", "size", "default",
        "attach", "model", "extension", "keyframe", "compiler")  # fmt: skip
ATTRIBUTES = {
    "file": ("/etc/passwd", "/dev/zero", "../x.stl", "x.obj", ""),
    "count": ("100000000", "-1", "3", "50 50 50"),
    "nrow": ("2", "100000"), "ncol": ("2", "100000"), "memory": ("1T", "0", "-1", "100G"),
    "type": ("mesh", "hfield", "sdf", "plane", "ball", "slide", "cylinder", "x"),
    "mesh": ("hull", "nothing"), "size": ("0", "1e300 1 1", "nan 1 1", "-1 -1 -1", "1 1 1 1 1"),
    "timestep": ("0", "-1", "nan", "1e300", "1e-300"), "name": NAMES[:6], "class": ("x", "main"),
    "vertex": ("0 0 0", "0 0 0 " * 100_000, "nan 0 0 1 0 0 0 1 0 0 0 1"), "mass": ("0", "nan", "1e308"),
    "diaginertia": ("0 0 0", "1 1 100"), "quat": ("0 0 0 0", "1e300 0 0 0"), "coordinate": ("global",),
    "range": ("1 -1", "nan nan"), "gravity": ("nan 0 0", "0 0 -1e300"), "meshdir": ("/", ".."),
    "nconmax": ("2000000000",), "njmax": ("2000000000",), "prefix": ("a",), "euler": ("1 2 3",),
}  # fmt: skip


class States(Import):
    """An HDF5 file of demonstrations, or a folder with ``states.npz``."""

    name = "MuJoCo states"
    read_by = ("h5py", "mujoco")

    def write(self, folder: Path) -> tuple[Path, str]:
        """Rows in both layouts, each in a folder of its own."""
        self.model = scene(bodies=BODIES, rest=REST)
        states = settled(self.model, rows=12)
        (folder / "hdf5").mkdir(parents=True)
        about = {"env": "Lift", "env_args": json.dumps({"env_kwargs": {"control_freq": 20}})}
        demo_file(
            folder / "hdf5/demo.hdf5", self.model, states, about=about,
            actions=np.zeros((12, 7)), rewards=np.array([0.0] * 11 + [1.0]),
        )  # fmt: skip
        extras = folder / "npz/extras/episode_000001"
        extras.mkdir(parents=True)
        np.savez(extras / "states.npz", states=states)
        (extras / "model.xml.gz").write_bytes(gzip.compress(self.model.encode()))
        (extras / "ep_meta.json").write_text(json.dumps({"lang": "lift it"}))
        (extras.parent / "dataset_meta.json").write_text(about["env_args"])
        self.states = states
        return folder / "hdf5/demo.hdf5", ""

    def said(self) -> str:
        """Roles alone: the model has the shapes."""
        return '[every]\ntask = "Push"\nroles = { target = ["cube"] }\n'

    def chosen(self, rng: Random, path: Path) -> Path:
        """One of the two."""
        self.other = rng.random() < 0.4
        return path / ("npz" if self.other else "hdf5/demo.hdf5")

    def hurt(self, rng: Random, path: Path) -> tuple[str, bool]:
        """The model, the states, or bytes of a file."""
        place, act = self.chosen_place(path), rng.random()
        if act < 0.45:
            model, what = self.modelled(rng)
            if self.other:
                (place / "model.xml.gz").write_bytes(gzip.compress(model, 1))
            else:
                _with_model(place / "demo.hdf5", model)
            return f"model: {what}", False
        if act < 0.6:
            states, what = self.stated(rng)
            if self.other:
                np.savez(place / "states.npz", states=states)
            else:
                with h5py.File(place / "demo.hdf5", "a") as file:
                    del file["data/demo_1/states"]
                    file["data/demo_1/states"] = states
            lost = what == "number" and not np.isfinite(states).all()
            return f"states: {what}", lost
        return super().hurt(rng, place)

    def whole(self) -> Sound:
        """That of the same layout."""
        of = [
            w for w in self.wholes if ("npz" in str(w.episode.header.source.episode)) == self.other
        ]
        return of[0]

    def chosen_place(self, path: Path) -> Path:
        """The folder of the chosen one's files."""
        return path / ("npz/extras/episode_000001" if self.other else "hdf5")

    def modelled(self, rng: Random) -> tuple[bytes, str]:
        """Bytes of the model, or an element or attribute of it."""
        if rng.random() < 0.3:
            data = self.model.encode()
            return damaged(rng, data, [i for i, c in enumerate(data) if c in b'<>"='])
        root = ET.fromstring(self.model)
        every = list(root.iter())
        owner, label = rng.choice(every), ""
        for _ in range(rng.choice((1, 1, 2, 4))):
            owner, act = rng.choice(every), rng.random()
            if act < 0.35:
                name = rng.choice([*owner.attrib, *owner.attrib, *ATTRIBUTES])
                values = (*ATTRIBUTES.get(name, ()), *map(str, NUMBERS), *NAMES[1:4])
                owner.set(name, rng.choice(values))
                label = f"{owner.tag} {name}={owner.get(name)[:30]!r}"
            elif act < 0.75:
                tag = rng.choice(TAGS)
                child = ET.SubElement(owner, tag)
                for name in rng.sample(list(ATTRIBUTES), rng.choice((0, 1, 2, 3))):
                    child.set(name, rng.choice(ATTRIBUTES[name]))
                label = f"{owner.tag} with {tag} {dict(child.attrib)}"[:200]
            elif act < 0.85 and len(owner):
                owner.remove(owner[0])
                label = f"{owner.tag} less"
            elif act < 0.97:
                owner.append(
                    rng.choice(
                        [e for e in every if all(o is not owner for o in e.iter())]
                        or [ET.Element("body")]
                    )
                )
                label = f"{owner.tag} with another's child"
            else:
                for _ in range(rng.choice((100, 2000))):
                    owner = ET.SubElement(owner, "body")
                label = "deep"
        try:
            return ET.tostring(root), label
        except (ValueError, TypeError, RecursionError):
            return self.model.encode()[:-20], "cut"

    def stated(self, rng: Random) -> tuple[np.ndarray, str]:
        """Other states."""
        states, act = self.states.copy(), rng.choice(("number", "shape", "kind", "rows", "time"))
        if act == "number":
            with np.errstate(all="ignore"):
                states.flat[rng.randrange(states.size)] = float(rng.choice(NUMBERS))
        elif act == "shape":
            states = np.resize(
                states, rng.choice(((0,), (3,), (1, 21), (0, 21), (3, 1), (1, 3, 21)))
            )
        elif act == "kind":
            kind = rng.choice(("f2", "i8", "c8", "S3", "u1", "bool"))
            with np.errstate(all="ignore"):
                states = np.nan_to_num(states).astype(kind)
        elif act == "rows":
            states = np.repeat(states, rng.choice((1, 2, 50)), axis=0)[: -rng.choice((1, 2))]
        else:
            states[:, 0] = rng.choice((0, -1, 1e300, np.r_[1, 1:12], np.r_[12:0:-1]))
        return states, act


def _with_model(path: Path, model: bytes) -> None:
    with h5py.File(path, "a") as file:
        attributes = file["data/demo_1"].attrs
        attributes["model_file"] = np.void(model) if b"\0" in model else model


TARGETS = {"mujoco": States}
