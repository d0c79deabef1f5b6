"""Finding episodes in files, folders and datasets, by content rather than by name."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from safestage_eval.episode import Episode, Header
from safestage_eval.errors import TraceError, visible

from .episode_ref import EpisodeRef, Format
from .header_limits import demand_text
from .parquet import dataset_layout as layout
from .remote_path import RemotePath, as_path, forget, walk
from .trace_files import regular_status

MCAP_MAGIC = b"\x89MCAP0\r\n"
PARQUET_MAGIC = b"PAR1"
RESULTS = (".jsonl", ".json", ".csv")
"""Endings of results, which are taken for traces by mistake."""

REF_FIELDS = (
    "task",
    "stage",
    "family",
    "instruction",
    "prompt",
    "policy",
    "seed",
    "rollout",
    "physics_dt",
    "frame_dt",
    "control_dt",
    "success",
    "success_time",
    "termination",
    "horizon",
    "post_success_hold",
    "force_source",
    "schema_version",
)
"""Header fields that a reference carries; with them ``length`` and ``content_hash``."""


def load(
    path: str | Path | EpisodeRef,
    episode: str | None = None,
    *,
    recover: bool = False,
    checked: bool = True,
) -> Episode:
    """Open the episode at a path: an MCAP or ZIP file, a dataset, or a folder with a single episode.

    Args:
        path: where to look; or one of those that ``discover`` returns.
        episode: its id, where there are several.
        recover: of an MCAP file that was cut off, take the frames that are whole.
        checked: raise on broken invariants, now or when a column is first looked at.

    Raises:
        TraceError: nothing there, several episodes and none chosen, or the chosen one is broken.
    """
    if isinstance(path, EpisodeRef):
        return path.open(recover=recover, checked=checked)
    refs = discover([path])
    if episode is not None:
        refs = [ref for ref in refs if ref.episode_id == episode]
    if len(refs) != 1:
        some = ", ".join(ref.episode_id or ref.path.name for ref in discover([path])[:8])
        raise TraceError(
            str(path),
            f"{len(refs)} episodes are named {episode!r}."
            if episode is not None
            else f"{len(refs)} episodes are here.",
            some,
            "choose one: load(path, episode=…)",
        )
    return refs[0].open(recover=recover, checked=checked)


def discover(
    paths: str | Path | Iterable[str | Path], *, maybe_none: bool = False
) -> list[EpisodeRef]:
    """Return all episodes under the paths, ordered by name.

    A file or row that cannot be read becomes a reference with a ``problem``, so that it does not
    stop the others. A rollout that ended in an error is left out where it was tried again: another
    episode has its id.

    Args:
        paths: files and folders.
        maybe_none: of a folder that is written to, which may have no episode yet.

    Raises:
        TraceError: a path does not exist, or there is no episode under it.
    """
    return _without_tried_again(list(find(paths, maybe_none=maybe_none)))


def find(
    paths: str | Path | Iterable[str | Path], *, maybe_none: bool = False
) -> Iterator[EpisodeRef]:
    """Yield every episode under the paths; each file is opened when its turn comes.

    That nothing is under one of several paths is noticed when its turn comes as well. Those that
    ended in an error are all there, also when they were tried again.
    """
    places = [paths] if isinstance(paths, str | Path) else list(paths)
    if not places:
        raise TraceError("traces", "no path given.", "MCAP files, datasets, folders")
    forget()
    seen: set[Path] = set()
    for path in map(as_path, places):
        with _reached(path):
            if not path.exists():
                raise TraceError(str(path), "no such file or folder", fix="check the spelling")
    for path in map(as_path, places):
        empty = True
        with _reached(path):
            files = iter([refs_of_file(path)] if path.is_file() else _refs_of_folder(path))
        while True:
            with _reached(path):
                refs = next(files, None)
            if refs is None:
                break
            empty = empty and not refs
            place = _real(refs[0].path) if refs else path
            if place not in seen:
                seen.add(place)
                yield from _each_once(refs)
        if empty and not maybe_none:
            raise TraceError(
                str(path),
                "no episode in here.",
                "MCAP files, ZIP files of safestage-record, or datasets (a folder with meta/info.json)",
                "record some first, or give the folder that holds them",
            )


@contextmanager
def _reached(path: Path) -> Iterator[None]:
    """Turn an OSError of a file system or a store into a TraceError."""
    try:
        yield
    except OSError as error:
        raise TraceError(
            str(path),
            f"cannot be read: {error.strerror or error}",
            fix="look whether it can be reached from here, and with which rights",
        ) from None


def _each_once(refs: list[EpisodeRef]) -> Iterable[EpisodeRef]:
    """Drop rows of a file with the index of an earlier one: they would be the same episode."""
    first: dict[int | None, EpisodeRef] = {}
    for ref in refs:
        first.setdefault(ref.episode_index, ref)
    return first.values()


def _without_tried_again(refs: list[EpisodeRef]) -> list[EpisodeRef]:
    """Drop episodes that ended in an error where another one has their id, but never the last of an id."""
    failed = [ref for ref in refs if aborted(ref)]
    if not failed:
        return refs
    left = Counter(ref.episode_id for ref in refs)
    gone = set()
    for ref in failed:
        if left[ref.episode_id] > 1:
            left[ref.episode_id] -= 1
            gone.add(id(ref))
    return [ref for ref in refs if id(ref) not in gone]


def aborted(ref: EpisodeRef) -> bool:
    """True if the rollout ended in an error: the recorder failed, which says nothing about the policy."""
    return ref.problem is None and ref.fields.get("termination") == "error"


def refs_of_file(path: Path) -> list[EpisodeRef]:
    """Return the episodes of one file: an MCAP, a recorder's ZIP, or a file of ``meta/episodes``.

    Raises:
        TraceError: the file is neither.
    """
    with path.open("rb") as stream:
        magic = stream.read(64)
    single = _single(path, magic)
    if single is not None:
        return [_single_ref(path, single)]
    if path.name == "info.json" and layout.is_dataset(path.parents[1]):
        return [ref for refs in _refs_of_folder(path.parents[1]) for ref in refs]
    if path.parent.parts[-2:] == ("meta", "episodes") and path.suffix == ".parquet":
        return _dataset_refs(path)
    problem = "neither an MCAP nor a dataset's file, nor a recorder's ZIP"
    fix = "results of safestage score go to safestage report tables, compare or report"
    if magic.startswith(PARQUET_MAGIC):
        problem = "a Parquet file, but not one of meta/episodes"
        fix = f"give the folder that has meta/info.json; {fix}"
    raise TraceError(
        str(path),
        f"{problem}.",
        "an MCAP file, a ZIP file of safestage-record, a file of meta/episodes, or the dataset's folder",
        fix
        if magic.startswith(PARQUET_MAGIC) or path.suffix in RESULTS
        else f"a recording of another format is imported first: safestage import {path} --to DATASET",
    )


def _refs_of_folder(folder: Path) -> Iterator[list[EpisodeRef]]:
    """Yield the episodes of each file."""
    for here, folders, files in walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        if "meta" in folders and (layout.is_dataset(here) or _has_rows(here)):
            yield from _refs_of_dataset(here)
            own = ("meta", layout.ASSETS, *layout.TABLE_FOLDERS)
            folders[:] = [name for name in folders if name not in own]
        for name in sorted(files):
            path = here / name
            single = None if name.startswith(".") else _single(path, _beginning(path))
            if single is not None:
                yield [_single_ref(path, single)]


def _has_rows(folder: Path) -> bool:
    """True if a folder has rows of episodes as a dataset; without ``meta/info.json`` they cannot be read."""
    return any((folder / layout.EPISODES).glob("[!.]*.parquet"))


def _refs_of_dataset(dataset: Path) -> Iterator[list[EpisodeRef]]:
    try:
        layout.read_info(dataset)
    except TraceError as problem:
        yield [EpisodeRef(dataset / layout.INFO, "parquet", problem=problem)]
        return
    for file in sorted((dataset / layout.EPISODES).glob("[!.]*.parquet")):
        yield _dataset_refs(file)


def _dataset_refs(file: Path) -> list[EpisodeRef]:
    from .parquet.episode_row import read_rows

    columns = ("episode_index", "episode_id", *REF_FIELDS, "length", "content_hash", "file")
    try:
        rows = read_rows(file, columns)
    except TraceError as problem:
        return [EpisodeRef(file, "parquet", problem=problem)]
    return [_row_ref(file, row) for row in rows]


def _row_ref(file: Path, row: dict[str, Any]) -> EpisodeRef:
    """The episode of a row; one with names that are no text has a problem, and its names are escaped."""
    problem = None
    for name, value in row.items():
        try:
            demand_text(value, f"{file}, {name}")
        except TraceError as error:
            problem = problem or error
            row[name] = visible(value)
    return EpisodeRef(
        file,
        "parquet",
        row.pop("episode_id"),
        row.pop("episode_index"),
        stored_in=row.pop("file"),
        fields=row,
        problem=problem,
    )


def _single(path: Path, beginning: bytes) -> Format | None:
    """The format of a file that holds one episode, by its first bytes; None for any other."""
    if path.suffix == ".mcap" or beginning.startswith(MCAP_MAGIC):
        return "mcap"
    from .zip_reader import is_zip_trace

    return "zip" if is_zip_trace(beginning) else None


def _single_ref(path: Path, form: Format) -> EpisodeRef:
    if form == "mcap":
        from .mcap.mcap_reader import read_header
    else:
        from .zip_reader import read_zip_header as read_header

    try:
        regular_status(path)
        header, stated = read_header(path)
    except TraceError as problem:
        return EpisodeRef(path, form, problem=problem)
    except OSError as error:
        broken = TraceError(str(path), f"cannot be read: {error.strerror or error}")
        return EpisodeRef(path, form, problem=broken)
    return EpisodeRef(path, form, header.episode_id, None, ref_fields(header) | stated)


def ref_fields(header: Header) -> dict[str, Any]:
    """Return the fields of a reference to an episode, from its header."""
    return {name: getattr(header, name) for name in REF_FIELDS}


def _real(path: Path) -> Path:
    """Resolve links as far as possible; Path.resolve fails for one that leads to itself."""
    return path.resolve() if isinstance(path, RemotePath) else Path(os.path.realpath(path))


def _beginning(path: Path) -> bytes:
    """The first bytes of a file; none of what is no file, or cannot be read."""
    try:
        regular_status(path)
        with path.open("rb") as stream:
            return stream.read(64)
    except (OSError, TraceError):
        return b""
