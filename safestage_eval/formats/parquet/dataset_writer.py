"""Adding an episode to a Parquet dataset."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path

import pyarrow.parquet as pq

from safestage_eval.episode import Episode
from safestage_eval.formats.atomic import PART, replacing, sync, write_bytes
from safestage_eval.formats.ply import to_ply

from . import dataset_layout as layout
from .arrow_tables import arrow_file
from .dataset_tables import as_rows, episode_entry, episode_tables
from .episode_row import mesh_keys, to_row
from .table_digests import noted
from .table_writer import write_whole, writing_table


def add_episode(episode: Episode, dataset: Path) -> Path:
    """Write an episode as a new file set of the dataset; returns its ``meta/episodes`` file.

    The folder is made when it is not there. Each file appears whole, the one under
    ``meta/episodes`` last, so no reader ever sees half an episode; several recorders may add to
    the same dataset at once.

    Raises:
        TraceError: the folder is something else, or the header holds a number that is not finite.
    """
    to_row(episode.header)  # before anything is written
    layout.prepare(dataset)
    attachments = add_assets(episode, dataset)
    with _reserved(dataset) as (index, part):
        file = _file_name(index)
        digests: dict[str, list[str]] = {}
        for table, groups in episode_tables(episode, index).items():
            with (
                replacing(dataset / table / f"{file}.parquet") as path,
                writing_table(path, table) as writer,
            ):
                for group, runs in noted(table, groups, digests):
                    writer.add(group, runs)
        entry = episode_entry(episode, index, file, attachments, digests)
        write_whole(part, "meta/episodes", as_rows("meta/episodes", [entry]))
    return dataset / layout.EPISODES / f"{file}.parquet"


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
        for table in (dataset / name for name in layout.TABLE_FOLDERS):
            (table / final.name).unlink(missing_ok=True)
        raise


def highest_index(file: Path) -> int:
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
    for key in mesh_keys(episode.header):
        _add_asset(dataset, f"{key}.ply", to_ply(episode.meshes[key]))
    return {
        name: _add_asset(dataset, sha256(data).hexdigest() + _ending(name), data)
        for name, data in episode.attachments.items()
    }


def _ending(name: str) -> str:
    """Of an attachment's name, if a file can be called so anywhere."""
    ending = Path(name).suffix
    return ending if re.fullmatch(r"\.[A-Za-z0-9]{1,16}", ending) else ""


def _add_asset(dataset: Path, name: str, data: bytes) -> str:
    path = dataset / layout.ASSETS / name
    if not path.exists():
        write_bytes(path, data)
    return name
