"""Adding episodes to a Parquet dataset: one, or many in one file set."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from safestage_eval.episode import Episode
from safestage_eval.errors import TraceError
from safestage_eval.formats.atomic import PART, replacing, sync, write_bytes
from safestage_eval.formats.ply import to_ply

from . import dataset_layout as layout
from .arrow_tables import arrow_file, schema, write_options
from .dataset_tables import as_rows, episode_entry, episode_tables
from .episode_row import mesh_keys, to_row

GROUP_ROWS = 1 << 20
"""Most rows of a row group; an episode of a shard has its own."""


class Shard:
    """A file set that is being written, of one episode or many; its files appear together.

    Attributes:
        entries: rows of ``meta/episodes``.
    """

    def __init__(self, dataset: Path, file: str, first_index: int, files: ExitStack) -> None:
        """Nothing is written yet.

        Args:
            dataset: its folder.
            file: name of the files, without ending.
            first_index: of its episodes.
            files: closes the files, and renames them when all are whole.
        """
        self._dataset, self._file, self._first = dataset, file, first_index
        self._files = files
        self._writers: dict[str, pq.ParquetWriter] = {}
        self.entries: list[dict[str, Any]] = []

    def __len__(self) -> int:
        return len(self.entries)

    def add(self, episode: Episode) -> None:
        """Append an episode.

        Everything is read before anything is written, so one that is damaged leaves no trace.

        Raises:
            TraceError: the episode is damaged, or its header holds a number that is not finite.
        """
        index = self._first + len(self)
        header, tables = to_row(episode.header), episode_tables(episode, index)
        assets = add_assets(episode, self._dataset)
        entry = header | episode_entry(episode, index, self._file, assets)
        for table, rows in tables.items():
            writer = self._writers.get(table) or self._open(table)
            writer.write_table(rows, row_group_size=GROUP_ROWS)
        self.entries.append(entry)

    def _open(self, table: str) -> pq.ParquetWriter:
        path = self._files.enter_context(replacing(self._dataset / table / f"{self._file}.parquet"))
        sink = self._files.enter_context(arrow_file(path, "wb"))
        writer = pq.ParquetWriter(sink, schema(table), **write_options(table))
        self._writers[table] = self._files.enter_context(writer)
        return writer


@contextmanager
def writing_shard(dataset: Path, file: str, first_index: int) -> Iterator[Shard]:
    """Open a new file set ``<table>/<file>.parquet`` whose episodes count from ``first_index``.

    All of its files appear when the block ends well, the one under ``meta/episodes`` last; after
    an exception, or without any episode, there is none.

    Raises:
        TraceError: the folder holds something that is no dataset.
    """
    layout.prepare(dataset)
    with ExitStack() as files:
        shard = Shard(dataset, file, first_index, files)
        yield shard
    if shard.entries:
        with replacing(dataset / layout.EPISODES / f"{file}.parquet") as path:
            _write_entries(path, shard.entries)


def add_episode(episode: Episode, dataset: Path) -> Path:
    """Write an episode as a new file set of the dataset; return its ``meta/episodes`` file.

    The folder is made when it is not there. Each file appears whole, the one under
    ``meta/episodes`` last, so no reader ever sees half an episode; several recorders may add to
    the same dataset at once.

    Raises:
        TraceError: the folder is something else, or the header holds a number that is not finite.
    """
    to_row(episode.header)  # before anything is written
    layout.prepare(dataset)
    with _reserved(dataset) as (index, part):
        with ExitStack() as files:
            shard = Shard(dataset, _file_name(index), index, files)
            shard.add(episode)
        _write_entries(part, shard.entries)
    return dataset / layout.EPISODES / f"{_file_name(index)}.parquet"


def _write_entries(path: Path, entries: list[dict[str, Any]]) -> None:
    with arrow_file(path, "wb") as sink:
        pq.write_table(as_rows("meta/episodes", entries), sink, **write_options("meta/episodes"))


def remove_episode(dataset: Path, file: str) -> None:
    """Remove a file set that holds a single episode, its row of ``meta/episodes`` first.

    Raises:
        TraceError: other episodes are in the same files.
    """
    meta = dataset / layout.EPISODES / f"{file}.parquet"
    count = pq.read_metadata(meta).num_rows
    if count != 1:
        raise TraceError(
            str(meta), f"holds {count} episodes: one of them cannot be taken out.",
            fix="import into another folder",
        )  # fmt: skip
    meta.unlink()
    sync(meta.parent)
    for table in layout.TABLE_FOLDERS:
        (dataset / table / meta.name).unlink(missing_ok=True)


def _file_name(index: int) -> str:
    return f"episode-{index:06d}"


@contextmanager
def _reserved(dataset: Path) -> Iterator[tuple[int, Path]]:
    """The next free episode index, and the file that becomes the episode's row in the end.

    That file, under its temporary name, is the reservation: creating it fails when another
    recorder has it. One that was killed leaves it behind, and its index unused.
    """
    folder = dataset / layout.EPISODES
    folder.mkdir(parents=True, exist_ok=True)
    index = max((highest_index(file) for file in folder.iterdir()), default=-1) + 1
    while True:
        final = folder / f"{_file_name(index)}.parquet"
        part = folder / f".{final.name}{PART}"
        try:
            part.open("xb").close()
        except FileExistsError:
            index += 1
            continue
        if not final.exists():
            break
        part.unlink()
        index += 1
    try:
        yield index, part
        sync(part)
        part.replace(final)
        sync(folder)
    except BaseException:
        part.unlink(missing_ok=True)
        final.unlink(missing_ok=True)  # before its tables: a row without them is half an episode
        for table in (dataset / name for name in layout.TABLE_FOLDERS):
            (table / final.name).unlink(missing_ok=True)
        raise


def highest_index(file: Path) -> int:
    """Return the last episode index that a file of ``meta/episodes`` holds or reserves; −1 for none."""
    if match := re.match(r"\.?episode-(\d+)\.", file.name):
        return int(match[1])
    if file.suffix != ".parquet":
        return -1
    column = pq.read_table(arrow_file(file), columns=["episode_index"])["episode_index"]
    return max(column.to_pylist(), default=-1)


def add_assets(episode: Episode, dataset: Path) -> dict[str, str]:
    """Store the episode's meshes and attachments, each content once.

    Returns: name of an attachment → its file under ``assets``.
    """
    for key in mesh_keys(episode.header):
        if not (dataset / layout.ASSETS / f"{key}.ply").exists():
            _add_asset(dataset, f"{key}.ply", to_ply(episode.meshes[key]))
    return {
        name: _add_asset(dataset, sha256(data).hexdigest() + _ending(name), data)
        for name, data in episode.attachments.items()
    }


def _ending(name: str) -> str:
    """Return the ending of an attachment's name, "" where not every file system can hold it."""
    ending = Path(name).suffix
    return ending if re.fullmatch(r"\.[A-Za-z0-9]{1,16}", ending) else ""


def _add_asset(dataset: Path, name: str, data: bytes) -> str:
    path = dataset / layout.ASSETS / name
    if not path.exists():
        write_bytes(path, data)
    return name
