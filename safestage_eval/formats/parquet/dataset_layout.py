"""Names inside a dataset folder, and its ``meta/info.json``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from safestage_eval._text.json_text import from_json
from safestage_eval.episode import SCHEMA_VERSION
from safestage_eval.errors import TraceError
from safestage_eval.formats.atomic import write_bytes
from safestage_eval.formats.trace_files import check_link, regular_status

INFO = "meta/info.json"
EPISODES = "meta/episodes"
ASSETS = "assets"

TABLE_FOLDERS = ("bodies", "contacts", "frames", "channels", "states", "geometry")

_DESCRIPTION = {
    "format": "safestage",
    "schema_version": SCHEMA_VERSION,
    "units": {
        "length": "m",
        "angle": "rad",
        "time": "s",
        "mass": "kg",
        "force": "N",
        "torque": "N m",
    },
    "conventions": {
        "frame": "world, right-handed, z up",
        "quaternion": "wxyz, unit norm, body frame to world",
        "velocity": "of the body frame's origin, world",
        "contact": "normal from body1 to body2; force on body2 by body1",
        "time": "seconds from the episode's start, strictly increasing",
    },
    "paths": {
        "episodes": "meta/episodes/{file}.parquet",
        "bodies": "bodies/{file}.parquet",
        "contacts": "contacts/{file}.parquet",
        "frames": "frames/{file}.parquet",
        "channels": "channels/{file}.parquet",
        "states": "states/{file}.parquet",
        "geometry": "geometry/{file}.parquet",
        "mesh": "assets/{sha256}.ply",
    },
}


def is_dataset(folder: Path) -> bool:
    """True if the folder holds a dataset."""
    return (folder / INFO).is_file()


def check_version(version: str, where: str) -> None:
    """Raise TraceError for a newer (or unreadable) major version of the format."""
    own = SCHEMA_VERSION.partition(".")[0]
    major = str(version).partition(".")[0]
    if major != own:
        newer = major.isdigit() and (len(major), major) > (len(own), own)
        raise TraceError(
            where,
            f"trace format {version} cannot be read by this version.",
            f"{own}.x",
            "install a newer safestage" if newer else "",
        )


def read_info(dataset: Path) -> dict[str, Any]:
    """Read ``meta/info.json``. Raises TraceError when it is missing, broken or of a newer major."""
    path = dataset / INFO
    try:
        check_link(path, dataset, str(path))
        regular_status(path)
        info = from_json(path.read_text("utf-8"))
        version = info["schema_version"]
    except FileNotFoundError:
        raise TraceError(
            str(dataset), f"not a whole dataset: {INFO} is missing",
            fix="copy the dataset again, with all of its folders",
        ) from None  # fmt: skip
    except (ValueError, KeyError, TypeError, RecursionError, OSError) as error:
        raise TraceError(
            str(path), f"not a dataset's description: {error}.", "JSON with schema_version"
        ) from None
    check_version(version, str(path))
    return dict(info)


def prepare(dataset: Path) -> None:
    """Make the folder a dataset, or check that it is one that this version may add to."""
    if is_dataset(dataset):
        read_info(dataset)
        return
    if dataset.exists() and not dataset.is_dir():
        raise TraceError(str(dataset), "a file stands where the dataset's folder should be")
    text = json.dumps(_DESCRIPTION, indent=2, ensure_ascii=False) + "\n"
    write_bytes(dataset / INFO, text.encode())
