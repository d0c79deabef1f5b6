"""Identity of the state of a trace's files and of the code that reads them."""

from __future__ import annotations

import hashlib
import os
import platform
from collections.abc import Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path

import numpy as np

from safestage_eval.formats import EpisodeRef
from safestage_eval.formats.parquet.dataset_layout import TABLE_FOLDERS
from safestage_eval.version import __version__

RACY = 2_000_000_000
"""ns: a file that changed less than this before it was looked at may change again unnoticed, because
some file systems keep time no finer."""


@cache
def code_version() -> str:
    """A digest of every source file of the package, and of what computes for it.

    Nobody has to remember to raise a number: any edit of the code makes all that was kept a miss.
    Empty where the sources cannot be read; then nothing is kept.
    """
    package = Path(__file__).parents[1]
    computes = f"{__version__} {np.__version__} {version('scipy')} {platform.machine()}"
    digest = hashlib.sha256(computes.encode())
    sources = sorted(package.rglob("*.py"))
    try:
        for source in sources:
            digest.update(source.relative_to(package).as_posix().encode())
            digest.update(source.read_bytes())
    except OSError:
        return ""
    return digest.hexdigest() if sources else ""


def stamp(ref: EpisodeRef) -> tuple[str, int] | None:
    """A digest of what the operating system knows about the files of an episode.

    Size, both times, and the number of each file: writing to a file, replacing it, or setting its
    time back changes at least one of them. Not its bytes: reading them all would cost as much as
    scoring. Meshes are not among them, they are named after their content.

    Returns:
        The digest, and the time (ns) of the latest change; None if a file is missing.
    """
    facts = [f"{ref.episode_id!r} {ref.episode_index} {ref.content_hash}"]
    latest = 0
    for path, needed in _files(ref):
        try:
            found = os.stat(path)  # noqa: PTH116
        except OSError:
            if needed:
                return None
            continue
        changed, touched = found.st_mtime_ns, found.st_ctime_ns
        text = f"{found.st_size} {changed} {touched} {found.st_ino} {found.st_dev}"
        facts.append(f"{path!r} {text}")
        latest = max(latest, changed, touched)
    return hashlib.sha256("\n".join(facts).encode()).hexdigest(), latest


def _files(ref: EpisodeRef) -> Iterator[tuple[str, bool]]:
    """The files of an episode, and whether each must be there."""
    path = os.path.abspath(ref.path)  # noqa: PTH100 - pathlib takes longer than asking the system
    yield path, True
    if ref.format != "parquet":
        return
    dataset = path.rsplit(os.sep, 3)[0]
    for table in TABLE_FOLDERS:
        yield f"{dataset}/{table}/{ref.stored_in}.parquet", table in ("bodies", "frames")
