"""An HDF5 file of a RoboLab or Isaac Lab recording: what all its demos share."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from . import hdf5
from .importer import QuaternionOrder, Settings, SourceError
from .isaac_sidecars import read_sidecars


class IsaacFile:
    """The file, open, and the files beside it.

    Attributes:
        data: the HDF5 group that holds the demos.
        sidecars: its configuration and its results.
    """

    def __init__(self, path: Path, settings: Settings) -> None:
        self.path, self.settings = path, settings
        self._file = hdf5.open_hdf5(path)
        self.data = self._file["data"]
        self.sidecars = read_sidecars(path)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def attribute(self, name: str) -> Any:
        """Return an attribute of ``data`` as text or number; None if it is missing."""
        value = self.data.attrs.get(name)
        return value.decode() if isinstance(value, bytes) else value

    def order(self) -> QuaternionOrder:
        """Return the order of the file's quaternions.

        Raises:
            SourceError: neither the file nor the user tells.
        """
        stated = self.settings.stated_order
        if stated is not None:
            return stated
        version = self.attribute("isaaclab_version")
        order = order_of(str(version)) if version is not None else None
        if order is not None:
            return order
        hint = self.sidecars.rotations_speak_for
        why = "has no isaaclab_version" if version is None else f"isaaclab_version is {version}"
        raise SourceError(
            str(self.path),
            f"the order of its quaternions is not known: {why}.",
            "wxyz up to Isaac Lab 2.3, xyzw from 3.0 on",
            "--quaternion wxyz or --quaternion xyzw"
            + (f" (the rotations in env_cfg.json look like {hint})" if hint else ""),
        )


def order_of(version: str) -> QuaternionOrder | None:
    """Return the quaternion order of a version of the package ``isaaclab``; None if it is not clear.

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
