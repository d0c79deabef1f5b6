"""Writes a trace as one ZIP file of NumPy arrays and a JSON header, whole or not at all.

The members are stored, not compressed: ``safestage.json`` first, by which the file is known, then
arrays in NumPy's own format. Every member has the CRC-32 that ZIP files have.
"""

from __future__ import annotations

import json
import os
import zipfile
from pathlib import Path
from typing import Any, Mapping
from uuid import uuid4

import numpy as np

from .record_error import RecordError

FORMAT = "safestage-zip"
VERSION = 1
HEADER = "safestage.json"

CONTACT_POINT = np.dtype(
    [
        ("position", "<f4", 3),
        ("normal", "<f4", 3),
        ("force", "<f4", 3),
        ("peak_force", "<f4"),
        ("depth", "<f4"),
        ("geom1", "<u2"),
        ("geom2", "<u2"),
    ]
)
"""One contact: m, unit vector from 1 to 2, N (on geom 2's body by geom 1's), N, m, all in the world
frame; indices of geoms counted over all bodies in the header's order."""


def write_zip(path: Path, facts: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    """Write a trace under a temporary name and rename it when every byte is on the disk.

    Args:
        path: of the file; its folder is made, and an older file replaced.
        facts: JSON of ``safestage.json``, besides format and version.
        arrays: member name without ``.npy`` → array.

    Raises:
        RecordError: the header holds a number that is not finite, or the file cannot be written.
    """
    try:
        about = {"format": FORMAT, "version": VERSION}
        about.update(facts)
        text = json.dumps(about, allow_nan=False, ensure_ascii=False).encode()
    except ValueError as error:
        raise RecordError(
            f"{path}: the header cannot be written: {error}. Allowed: finite numbers."
        ) from None
    part = path.with_name(f".{path.name}.{uuid4().hex[:8]}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with part.open("wb") as stream:
            with zipfile.ZipFile(stream, "w", zipfile.ZIP_STORED) as archive:
                archive.writestr(_member(HEADER), text)
                for name, values in arrays.items():
                    with archive.open(_member(f"{name}.npy"), "w", force_zip64=True) as member:
                        np.lib.format.write_array(
                            member, np.ascontiguousarray(values), allow_pickle=False
                        )
            stream.flush()
            os.fsync(stream.fileno())
        part.replace(path)
    except OSError as error:
        raise RecordError(f"{path}: cannot be written: {error.strerror or error}.") from error
    finally:
        if part.exists():
            part.unlink()


def _member(name: str) -> zipfile.ZipInfo:
    """Entry without the time of writing, so that equal traces have equal bytes."""
    return zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
