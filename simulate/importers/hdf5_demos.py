"""The HDF5 layout of robosuite, robomimic, LIBERO and MimicGen: ``data/demo_i/states``."""

from __future__ import annotations

import re
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from safestage_eval.importers.hdf5 import fingerprint, is_hdf5, layout, numbered, open_hdf5

from .stored_states import Stored, table_in


class DemoFile:
    """An open file of demonstrations."""

    def __init__(self, path: Path) -> None:
        """Raises SourceError when it cannot be opened."""
        self.path = path
        self._file: Any = open_hdf5(path)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    @classmethod
    def told_by(cls, path: Path) -> str | None:
        """By what a path is a file of MuJoCo states; None if it is none."""
        if not is_hdf5(path):
            return None
        file = cls(path)
        try:
            with layout(str(path)):
                return file._told_by()
        finally:
            file.close()

    def _told_by(self) -> str | None:
        import h5py

        data = self._file.get("data")
        if not isinstance(data, h5py.Group):
            return None
        names = self.names()
        if not names:
            return None
        demo = data[names[0]]
        if isinstance(demo.get("states"), h5py.Dataset):
            return f"data/{names[0]}/states"
        if "model_file" in demo.attrs:
            return f"the model_file of data/{names[0]}"
        return None

    def names(self) -> list[str]:
        """Names of the demonstrations, by number."""
        import h5py

        data = self._file.get("data")
        if not isinstance(data, h5py.Group):
            return []
        return numbered(name for name in data if isinstance(data.get(name), h5py.Group))

    def fingerprint(self, name: str) -> str:
        """Digest of the model, and of the ends of its data."""
        demo = self._file["data"][name]
        with layout(f"{self.path}:data/{name}"):
            model_text = str(demo.attrs.get("model_file", ""))
        model = sha256(model_text.encode()).hexdigest()
        return f"{model[:16]}{fingerprint(demo)[:16]}"

    def read(self, name: str) -> Stored:
        """One demonstration. Raises InputError when its data are damaged."""
        where = f"{self.path}:data/{name}"
        with layout(where):
            data = self._file["data"]
            demo = data[name]
            columns = {
                key: np.asarray(demo[key][()])
                for key in ("states", "actions", "ctrl", "rewards")
                if key in demo
            }
            actions, ctrl = (columns.get(key, np.zeros((0, 0))) for key in ("actions", "ctrl"))
            return Stored(
                where=where,
                model=_text(demo.attrs.get("model_file")),
                states=columns.get("states"),
                actions=actions if actions.ndim == 2 else np.zeros((0, 0)),
                ctrl=ctrl if ctrl.ndim == 2 else np.zeros((0, 0)),
                rewards=columns.get("rewards"),
                meta=table_in(demo.attrs.get("ep_meta")),
                about={k: _text(v) or v for k, v in data.attrs.items() if np.ndim(v) == 0},
                index=_number(name),
            )


def _number(name: str) -> int | None:
    digits = re.search(r"(\d+)$", name)
    return int(digits[1]) if digits else None


def _text(value: Any) -> str | None:
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return value if isinstance(value, str) else None
