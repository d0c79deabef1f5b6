"""The camera film of an episode, if there is one beside its trace."""

from __future__ import annotations

import mmap
from contextlib import suppress
from pathlib import Path

from safestage_eval.episode import Video
from safestage_eval.formats import EpisodeRef

VERDICT_MARK = b"safestage: shows the verdict"
"""Metadata mark of a film by ``safestage plot film`` that shows the evaluator's verdict."""


def film_of(ref: EpisodeRef, recorded: Video | None) -> Path | None:
    """The film that the header names, if it lies in the trace's folder; else ``video_of``."""
    if recorded is not None:
        home = ref.path.parents[2] if ref.format == "parquet" else ref.path.parent
        path = home / recorded.file
        inside = path.resolve().is_relative_to(home.resolve())
        if inside and path.is_file() and path.suffix.lower() in (".mp4", ".webm"):
            return path
    return video_of(ref)


def video_of(ref: EpisodeRef, folder: Path | None = None) -> Path | None:
    """``EPISODE_ID.mp4`` or ``TRACE.mp4`` in a folder, or else beside the trace or in ``videos``.

    A film that shows the verdict does not count.
    """
    home = ref.path.parents[2] if ref.format == "parquet" else ref.path.parent
    names = [f"{ref.episode_id}.mp4"]
    if ref.format != "parquet":
        names.append(f"{ref.path.stem}.mp4")
    for place in [folder] if folder is not None else [home, home / "videos"]:
        for name in names:
            path = place / name
            with suppress(OSError, ValueError):  # an id need not be a name that a file can have
                inside = path.resolve().is_relative_to(place.resolve())
                if inside and path.is_file() and not shows_verdict(path):
                    return path
    return None


def shows_verdict(path: Path) -> bool:
    """Whether a film is marked as showing the verdict."""
    if not path.stat().st_size:
        return False
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return data.find(VERDICT_MARK) >= 0
