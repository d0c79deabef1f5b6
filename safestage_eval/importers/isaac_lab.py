"""RoboLab and Isaac Lab recordings: HDF5 with ``data/demo_i/states/rigid_object/…``.

The layout is that of Isaac Lab's recorder (``InteractiveScene.get_state(is_relative=True)``) with
RoboLab's additions (github.com/NVlabs/RoboLab, docs/data.md). Facts that matter here:

- Row i of ``states`` is the world after action i; ``initial_state`` comes before, so there is one
  more frame than there are actions.
- Positions are relative to the environment's origin; orientations and velocities are the world's.
- ``root_velocity`` is that of the centre of mass.
- Quaternions are wxyz up to Isaac Lab 2.3 (package ``isaaclab`` 0.x, 2.0 to 2.3) and xyzw from 3.0
  on. ``initial_state/cameras`` has them as xyzw at all times; cameras are not taken over.
- RoboLab freezes an environment as soon as it succeeds: nothing is recorded afterwards.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from safestage_eval.episode import Episode

from . import hdf5
from .account import Account
from .importer import Importer, QuaternionOrder, Settings, SourceError
from .isaac_demo import Demo
from .isaac_sidecars import Sidecars, read_sidecars


class IsaacLab(Importer):
    """One HDF5 file."""

    name = "isaaclab"
    title = "RoboLab / Isaac Lab HDF5"

    def __init__(self, path: Path, settings: Settings) -> None:
        """Open the file and what stands beside it."""
        super().__init__(path, settings)
        self._file = hdf5.open_hdf5(path)
        self._data = self._file["data"]
        self._beside: Sidecars = read_sidecars(path)

    @classmethod
    def recognise(cls, path: Path) -> str | None:
        """By ``data/<demo>/states`` (or ``initial_state``) with ``articulation``, ``rigid_object``."""
        if not hdf5.is_hdf5(path):
            return None
        try:
            with hdf5.open_hdf5(path) as file:
                for name, demo in file["data"].items():
                    for part in ("states", "initial_state"):
                        for kind in ("rigid_object", "articulation"):
                            if f"{part}/{kind}" in demo:
                                return f"HDF5 with data/{name}/{part}/{kind}"
        except (KeyError, TypeError, AttributeError):
            return None
        return None

    def episodes(self) -> list[str]:
        """``demo_0``, ``demo_1``, … in order."""
        return hdf5.numbered(self._data)

    def fingerprint(self, name: str) -> str:
        """Of its datasets."""
        return hdf5.fingerprint(self._data[name])

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def read(self, name: str, account: Account) -> Episode:
        """One demo."""
        with hdf5.layout(f"{self.path}: {name}"):
            return Demo(self, name, account).episode()

    # what all demos of a file share

    @property
    def beside(self) -> Sidecars:
        """Its side files."""
        return self._beside

    def demo(self, name: str) -> Any:
        """The group of a demo."""
        return self._data[name]

    def attribute(self, name: str) -> Any:
        """An attribute of ``data``, as text or number; None if it is not there."""
        value = self._data.attrs.get(name)
        return value.decode() if isinstance(value, bytes) else value

    def order(self) -> QuaternionOrder:
        """The order of the file's quaternions.

        Raises:
            SourceError: neither the file nor the user tells.
        """
        said = self.settings.quaternion or self.settings.map.source.quaternion
        if said is not None:
            return said
        version = self.attribute("isaaclab_version")
        order = order_of(str(version)) if version is not None else None
        if order is not None:
            return order
        hint = self._beside.rotations_speak_for
        why = "has no isaaclab_version" if version is None else f"isaaclab_version is {version}"
        raise SourceError(
            str(self.path),
            f"the order of its quaternions is not known: {why}.",
            "wxyz up to Isaac Lab 2.3, xyzw from 3.0 on",
            "--quaternion wxyz or --quaternion xyzw"
            + (f" (the rotations in env_cfg.json look like {hint})" if hint else ""),
        )


def order_of(version: str) -> QuaternionOrder | None:
    """The quaternion order of a version of the package ``isaaclab``; None if it is not clear.

    Installed from source the package has the core extension's number, which was 0.x until the order
    changed and 1.0.0 (30 January 2026) when it did; the wheels are 2.0 to 2.3, then 3.0.
    """
    match = re.match(r"(\d+)(?:\.(\d+))?", version)
    if match is None:
        return None
    major, minor = int(match[1]), int(match[2] or 0)
    if major == 0 or (major == 2 and minor <= 3):
        return "wxyz"
    return "xyzw" if major >= 3 else None


IMPORTER = IsaacLab
