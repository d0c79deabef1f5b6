"""Folders of states: RoboCasa365's ``extras/episode_*/states.npz``, and those of robosuite's collector.

robosuite's DataCollectionWrapper writes ``ep_<time>/state_<time>.npz``, as many as it flushes, with
``model.xml`` and ``ep_meta.json`` beside them. Its actions are pickled, and not read.
"""

from __future__ import annotations

import gzip
import re
import zlib
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from safestage_eval.errors import InputError
from safestage_eval.importers.npz_arrays import npz_arrays

from .stored_states import Stored, table_in

LONGEST_MODEL = 1 << 28
"""Bytes; large ones have a few million."""


class StateFolders:
    """Folders of stored states, one for each episode."""

    def __init__(self, path: Path) -> None:
        """List the folders."""
        self._folders = {folder.name: folder for folder in _episode_folders(path)}

    @classmethod
    def told_by(cls, path: Path) -> str | None:
        """By ``episode_*/states.npz``, or robosuite's ``ep_*/state_*.npz``; None if there are none."""
        folders = _episode_folders(path) if path.is_dir() else []
        if not folders:
            return None
        file = "states.npz" if (folders[0] / "states.npz").is_file() else "state_*.npz"
        return f"{folders[0].name}/{file}"

    def names(self) -> list[str]:
        """Names of the folders, in order."""
        return list(self._folders)

    def fingerprint(self, name: str) -> str:
        """Digest of the states and the model."""
        digest, folder = sha256(), self._folders[name]
        for file in (*_state_files(folder), folder / "model.xml.gz", folder / "model.xml"):
            if file.is_file():
                digest.update(file.read_bytes())
        return digest.hexdigest()[:16]

    def read(self, name: str) -> Stored:
        """One episode. Raises InputError when a file is damaged."""
        return _read(self._folders[name])

    def close(self) -> None:
        """Nothing stays open."""


def _episode_folders(path: Path) -> list[Path]:
    """Those with stored states below a dataset's folder, its ``extras``, or of a single episode."""
    if _state_files(path):
        return [path]
    for folder in (path / "extras", path):
        result = sorted(file.parent for file in folder.glob("episode_*/states.npz"))
        result = result or sorted(
            (f for f in folder.glob("ep_*") if _state_files(f)), key=lambda f: _moment(f.name)
        )
        if result:
            return result
    return []


def _state_files(folder: Path) -> list[Path]:
    """RoboCasa's single file, or those that robosuite's collector wrote one after the other."""
    whole = folder / "states.npz"
    if whole.is_file():
        return [whole]
    return sorted(folder.glob("state_[0-9]*.npz"), key=lambda file: _moment(file.stem))


def _moment(name: str) -> tuple[float, str]:
    """The time in ``state_1700000000_25``, as robosuite writes ``time.time()``."""
    match = re.search(r"(\d+)_(\d+)$", name)
    return (float(f"{match[1]}.{match[2]}") if match else 0.0), name


def _read(folder: Path) -> Stored:
    """One episode. Raises InputError when a file is damaged."""
    where = str(folder)
    parts, about = [], _json(folder.parent / "dataset_meta.json")
    successful = None
    for part in _state_files(folder):
        arrays = npz_arrays(part, ("states", "env", "successful"))
        if "states" in arrays:
            parts.append(arrays["states"])
        if "env" in arrays:
            about = {"env": str(arrays["env"]), **about}
        if "successful" in arrays:
            successful = bool(np.any(arrays["successful"])) or bool(successful)
    widths = {rows.shape[1:] for rows in parts}
    if len(widths) > 1:
        raise InputError(where, f"its parts have rows of different widths: {sorted(widths)}.")
    states = np.concatenate(parts) if parts else None
    model: str | None = None
    for name, opened in (("model.xml.gz", gzip.open), ("model.xml", Path.open)):
        if (folder / name).is_file():
            try:
                with opened(folder / name, "rb") as stream:
                    model = stream.read(LONGEST_MODEL + 1).decode("utf-8")
                if len(model) > LONGEST_MODEL:
                    raise ValueError("more than 256 MiB of text")
            except (OSError, EOFError, zlib.error, ValueError) as error:
                raise InputError(f"{folder}/{name}", f"cannot be read: {error}") from None
            break
    number = re.search(r"(\d+)$", folder.name)
    return Stored(
        where=where,
        model=model,
        states=states,
        meta=_json(folder / "ep_meta.json"),
        about=about,
        successful=successful,
        index=int(number[1]) if number else None,
    )


def _json(file: Path) -> dict[str, Any]:
    try:
        return dict(table_in(file.read_bytes()))
    except OSError:
        return {}
