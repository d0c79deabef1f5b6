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

from pathlib import Path

from safestage_eval.episode import Episode

from . import hdf5
from .account import Account
from .importer import Importer, Settings
from .isaac_demo import Demo
from .isaac_file import IsaacFile


class IsaacLab(Importer):
    """One HDF5 file."""

    name = "isaaclab"
    title = "RoboLab / Isaac Lab HDF5"

    def __init__(self, path: Path, settings: Settings) -> None:
        """Open the file and what stands beside it."""
        super().__init__(path, settings)
        self._source = IsaacFile(path, settings)

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
        return hdf5.numbered(self._source.data)

    def fingerprint(self, name: str) -> str:
        """Return a digest of its datasets."""
        return hdf5.fingerprint(self._source.data[name])

    def close(self) -> None:
        """Close the file."""
        self._source.close()

    def read(self, name: str, account: Account) -> Episode:
        """Read one demo."""
        with hdf5.layout(f"{self.path}: {name}"):
            return Demo(self._source, name, account).read()


IMPORTER = IsaacLab
