"""The layout of RoboCasa365: ``extras/episode_*/states.npz`` with ``model.xml.gz`` beside it."""

from __future__ import annotations

import gzip
import re
import zlib
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from safestage_eval._text.json_text import from_json
from safestage_eval.errors import InputError

from .stored_states import Stored

LONGEST_MODEL = 1 << 28
"""Bytes; large ones have a few million."""


def episode_folders(path: Path) -> list[Path]:
    """Those with stored states below a dataset's folder, its ``extras``, or of a single episode."""
    if (path / "states.npz").is_file():
        return [path]
    for folder in (path / "extras", path):
        result = sorted(file.parent for file in folder.glob("episode_*/states.npz"))
        if result:
            return result
    return []


def fingerprint(folder: Path) -> str:
    """Digest of both files."""
    digest = sha256()
    for name in ("states.npz", "model.xml.gz"):
        if (folder / name).is_file():
            digest.update((folder / name).read_bytes())
    return digest.hexdigest()[:16]


def read(folder: Path) -> Stored:
    """One episode. Raises InputError when a file is damaged."""
    where = str(folder)
    try:
        with (folder / "states.npz").open("rb") as stream:
            arrays = np.load(stream, allow_pickle=False)
            if not isinstance(arrays, np.lib.npyio.NpzFile):
                raise ValueError("it is no archive")
            states = np.asarray(arrays["states"]) if "states" in arrays else None
    except Exception as error:  # noqa: BLE001 — zipfile and numpy fail in many ways on damaged bytes
        said = str(error) or type(error).__name__
        raise InputError(f"{folder}/states.npz", f"cannot be read: {said}") from None
    model: str | None = None
    for name, opened in (("model.xml.gz", gzip.open), ("model.xml", Path.open)):
        if (folder / name).is_file():
            try:
                with opened(folder / name, "rb") as file:
                    model = file.read(LONGEST_MODEL + 1).decode("utf-8")
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
        about=_json(folder.parent / "dataset_meta.json"),
        index=int(number[1]) if number else None,
    )


def _json(file: Path) -> dict[str, Any]:
    try:
        table = from_json(file.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return table if isinstance(table, dict) else {}
