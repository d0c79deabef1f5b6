"""Writing an episode in either format."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

from safestage_eval.episode import Episode, check
from safestage_eval.errors import TraceError

from .discover import refs_of_file
from .episode_ref import EpisodeRef, Format
from .event import Event
from .header_limits import as_stored

LONGEST_NAME = 160
"""Bytes of a file's name without its ending; file systems hold 255."""


def save(
    episode: Episode,
    path: str | Path,
    format: Format | None = None,  # noqa: A002
    events: Sequence[Event] = (),
) -> EpisodeRef:
    """Write an episode to a file, whole or not at all.

    Args:
        episode: any; it is checked first.
        path: an MCAP file, which is replaced when it exists, or the folder of a Parquet dataset,
            to which the episode is added.
        format: ``parquet`` or ``mcap``; without it a name ending in ``.mcap`` means MCAP.
        events: remarks for viewers; only an MCAP file has them.

    Raises:
        TraceError: the episode breaks an invariant, or the path cannot be written to.
    """
    target = Path(path)
    header = as_stored(episode.header)
    if header is not episode.header:
        episode = replace(episode, header=header)
    problems = check(episode)
    if problems:
        first = problems[0]
        more = f" ({len(problems)} problems in all)" if len(problems) > 1 else ""
        raise TraceError(first.where, first.what + more, first.allowed, first.fix)
    kind = format or ("mcap" if target.suffix.lower() == ".mcap" else "parquet")
    try:
        if kind == "mcap":
            from .mcap.mcap_writer import write_mcap

            write_mcap(episode, target, events)
            return refs_of_file(target)[0]
        if kind == "parquet":
            from .parquet.dataset_writer import add_episode

            return refs_of_file(add_episode(episode, target))[0]
    except OSError as error:
        raise TraceError(str(target), f"cannot be written: {error.strerror or error}") from error
    raise TraceError(str(target), f"there is no format {kind!r}.", "parquet, mcap")


def mcap_name(episode_id: str) -> str:
    """Return the name of an episode's MCAP file; characters that not every file system can hold become ``_``."""
    plain = re.sub(r"[^\w.+=@-]", "_", episode_id).lstrip(".")
    return f"{short_name(plain or '_')}.mcap"


def short_name(name: str) -> str:
    """A name that file systems can hold, with endings: the end of a long one becomes its digest."""
    data = name.encode("utf-8", "replace")
    if len(data) <= LONGEST_NAME:
        return name
    return f"{data[: LONGEST_NAME - 17].decode('utf-8', 'ignore')}-{sha256(data).hexdigest()[:16]}"
