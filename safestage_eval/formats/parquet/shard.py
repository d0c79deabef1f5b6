"""Many episodes in one file set of a Parquet dataset."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from safestage_eval.episode import Episode
from safestage_eval.formats.atomic import replacing

from . import dataset_layout as layout
from .dataset_tables import as_rows, episode_entry, episode_tables
from .dataset_writer import add_assets
from .episode_row import to_row
from .table_digests import noted
from .table_writer import TableWriter, write_whole, writing_table


class Shard:
    """A file set that is being written; made by ``writing_shard``."""

    def __init__(self, dataset: Path, file: str, first_index: int, files: ExitStack) -> None:
        self._dataset, self._file, self._first = dataset, file, first_index
        self._files = files
        self._writers: dict[str, TableWriter] = {}
        self.entries: list[dict[str, Any]] = []

    def __len__(self) -> int:
        return len(self.entries)

    def add(self, episode: Episode) -> None:
        """Write an episode after those that are in already.

        Everything is read before anything is written, so one that is damaged leaves no trace.

        Raises:
            TraceError: the episode is damaged, or its header holds a number that is not finite.
        """
        to_row(episode.header)
        index = self._first + len(self)
        digests: dict[str, list[str]] = {}
        whole = {
            table: list(noted(table, groups, digests))
            for table, groups in episode_tables(episode, index).items()
        }
        assets = add_assets(episode, self._dataset)
        entry = episode_entry(episode, index, self._file, assets, digests)
        for table, groups in whole.items():
            writer = self._writers.get(table) or self._open(table)
            for group, runs in groups:
                writer.add(group, runs)
        self.entries.append(entry)

    def _open(self, table: str) -> TableWriter:
        path = self._files.enter_context(replacing(self._dataset / table / f"{self._file}.parquet"))
        writer = self._files.enter_context(writing_table(path, table))
        self._writers[table] = writer
        return writer


@contextmanager
def writing_shard(dataset: Path, file: str, first_index: int) -> Iterator[Shard]:
    """A new file set ``<table>/<file>.parquet`` whose episodes count from ``first_index``.

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
            write_whole(path, "meta/episodes", as_rows("meta/episodes", shard.entries))
