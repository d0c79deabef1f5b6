"""Adding episodes to a Parquet dataset: one, or many in one file set."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from safestage_eval.episode import ContactTable, Episode
from safestage_eval.errors import TraceError
from safestage_eval.formats.atomic import PART, replacing, sync, write_bytes
from safestage_eval.formats.ply import to_ply
from safestage_eval.formats.trace_files import arrow_file

from . import dataset_layout as layout
from .arrow_columns import Words, to_table
from .arrow_tables import ROBOT_COLUMNS, schema, write_options
from .dataset_reader import TRACK_COLUMNS
from .episode_row import TABLE, encode, to_rows

GROUP_ROWS = 1 << 20
"""Most rows of a row group; an episode of a shard has its own."""

_NEXT: dict[Path, tuple[int, int]] = {}
"""Folder of ``meta/episodes`` → when it was changed by this process, and the index behind the last one in it then.

To look through all files for each episode would take the square of their number.
"""


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
        """Append an episode. Raises TraceError where its header holds a number that is not finite."""
        index, name = self._first + len(self), episode.header.episode_id
        header, geometry = to_rows(episode.header, index)
        tables = _tables(episode, index)
        tables["geometry"] = pa.Table.from_pylist(geometry, schema("geometry"))
        attachments = add_assets(episode, self._dataset)
        for table, rows in tables.items():
            writer = self._writers.get(table) or self._open(table)
            writer.write_table(rows, row_group_size=GROUP_ROWS)
        self.entries.append(
            header
            | {
                "episode_index": index,
                "file": self._file,
                "length": len(episode),
                "contacts": len(episode.contacts),
                "channels": encode([list(key) for key in episode.channels], name),
                "states": len(episode.states),
                "attachments": encode(attachments, name),
                "content_hash": episode.content_hash,
            }
        )

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
    to_rows(episode.header, 0)  # before anything is written
    layout.prepare(dataset)
    with _reserved(dataset) as (index, part):
        with ExitStack() as files:
            shard = Shard(dataset, _file_name(index), index, files)
            shard.add(episode)
        _write_entries(part, shard.entries)
    return dataset / layout.EPISODES / f"{_file_name(index)}.parquet"


def _write_entries(path: Path, entries: list[dict[str, Any]]) -> None:
    with arrow_file(path, "wb") as sink:
        rows = pa.Table.from_pylist(entries, schema(TABLE))
        pq.write_table(rows, sink, **write_options(TABLE))


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
    _remove_tables(dataset, meta.name)


def _remove_tables(dataset: Path, name: str) -> None:
    for table in layout.TABLE_FOLDERS:
        (dataset / table / name).unlink(missing_ok=True)


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
    here = folder.absolute()
    changed, index = _NEXT.get(here, (0, 0))
    if changed != folder.stat().st_mtime_ns:
        index = next_index(dataset)
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
        _NEXT[here] = folder.stat().st_mtime_ns, index + 1
    except BaseException:
        part.unlink(missing_ok=True)
        final.unlink(missing_ok=True)  # before its tables: a row without them is half an episode
        _remove_tables(dataset, final.name)
        raise


def next_index(dataset: Path) -> int:
    """Return the index behind all that the files of ``meta/episodes`` hold or reserve."""
    return max(map(_highest_index, (dataset / layout.EPISODES).glob("*")), default=-1) + 1


def _highest_index(file: Path) -> int:
    """The last episode index that a file of ``meta/episodes`` holds or reserves; −1 for none."""
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
    assets = dataset / layout.ASSETS
    for key in episode.header.mesh_keys:
        if not (assets / f"{key}.ply").exists():
            write_bytes(assets / f"{key}.ply", to_ply(episode.meshes[key]))
    files = {}
    for name, data in episode.attachments.items():
        ending = re.fullmatch(r"\.[A-Za-z0-9]{1,16}", Path(name).suffix)  # on every file system
        files[name] = sha256(data).hexdigest() + (ending[0] if ending else "")
        if not (assets / files[name]).exists():
            write_bytes(assets / files[name], data)
    return files


def _tables(episode: Episode, index: int) -> dict[str, pa.Table]:
    """Table → its rows of an episode; ``channels`` and ``states`` only where it has any.

    Raises TraceError where a column that is looked at for the first time is damaged.
    """
    contacts, robot = episode.contacts, episode.frames
    slot = _slots(contacts)
    order = np.lexsort((contacts.frame, slot, contacts.body2, contacts.body1))
    touching = vars(contacts.where(order))
    names = [body.name for body in episode.header.bodies]
    # moving bodies first, and the rows of each body together
    bodies = sorted(episode.header.bodies, key=lambda body: not body.movable)
    tracks = [episode.tracks[body.name] for body in bodies]
    motion = {name: _joined([getattr(t, name) for t in tracks]) for name in TRACK_COLUMNS}
    columns = {
        "bodies": _by_frame({"body": [body.name for body in bodies]}, list(map(len, tracks)))
        | motion,
        "contacts": touching
        | {
            "frame_index": touching["frame"],
            "slot": slot[order],
            "body1": Words(touching["body1"], names),
            "body2": Words(touching["body2"], names),
        },
        "frames": {"frame_index": np.arange(len(episode), dtype=np.int32), "timestamp": episode.t}
        | {column: getattr(robot, name) for name, column in ROBOT_COLUMNS.items()},
    }
    if episode.channels:
        values = list(episode.channels.values())
        of, what = (list(names) for names in zip(*episode.channels, strict=True))
        keys = _by_frame({"body": of, "name": what}, list(map(len, values)))
        columns["channels"] = keys | {"value": np.concatenate(values)}
    if episode.states:
        frames, states = zip(*sorted(episode.states.items()), strict=True)
        lengths = sorted({len(state) for state in states})
        if len(lengths) > 1:
            why = f"simulator states have {lengths[0]} to {lengths[-1]} numbers."
            raise TraceError(episode.header.episode_id, why, "states of one length")
        columns["states"] = {"frame_index": np.array(frames, np.int32), "state": np.stack(states)}
    return {
        table: to_table(
            table, some | {"episode_index": np.full(len(some["frame_index"]), index, np.int32)}
        )
        for table, some in columns.items()
    }


def _by_frame(names: dict[str, list[str]], rows: list[int]) -> dict[str, Any]:
    """Columns that say of each row, of things with so many each, what it is of, and the frame."""
    frames = [np.arange(n, dtype=np.int32) for n in rows]
    of = np.repeat(np.arange(len(rows)), rows)
    words = {column: Words(of, some) for column, some in names.items()}
    return {"frame_index": np.concatenate([np.zeros(0, np.int32), *frames]), **words}


def _joined(parts: list[NDArray[np.float32]]) -> NDArray[np.float32]:
    return np.concatenate(parts) if parts else np.zeros((0, 4), np.float32)


def _slots(contacts: ContactTable) -> NDArray[np.int16]:
    """(C,) number of each contact within its frame and pair, in the table's order."""
    if not len(contacts):
        return np.zeros(0, np.int16)
    first = np.ones(len(contacts), bool)
    first[1:] = contacts.frame[1:] != contacts.frame[:-1]
    first[1:] |= contacts.body1[1:] != contacts.body1[:-1]
    first[1:] |= contacts.body2[1:] != contacts.body2[:-1]
    rows = np.arange(len(contacts))
    return (rows - np.maximum.accumulate(np.where(first, rows, 0))).astype(np.int16)
