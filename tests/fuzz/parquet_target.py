"""Hostile Parquet datasets."""

from __future__ import annotations

import json
import math
import os
import shutil
from pathlib import Path
from random import Random

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from damage import damaged
from oracle import Sound, judged, sound
from outcome import Outcome
from parquet_footers import footer, page, some_file, some_table
from seeds import recorded, rules
from strange import NAMES, NUMBERS, altered, strange
from trace_target import used

from safestage_eval.formats import save
from safestage_eval.formats.parquet.arrow_tables import schema, write_options

JSON_COLUMNS = (
    "bodies", "joints", "roles", "goal", "rules", "parameters", "source", "notes", "channels",
    "attachments", "gravity",
)  # fmt: skip


class Parquet:
    """Datasets of one episode, with one of their files damaged or replaced."""

    name = "Parquet dataset"
    read_by = ("pyarrow", "lz4", "zstandard")

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.seeds: list[tuple[Path, Sound]] = []
        for i, episode in enumerate(recorded()):
            path = folder / f"seed{i}"
            save(episode, path, "parquet")
            self.seeds.append((path, sound(path, rules())))

    def run(self, rng: Random) -> Outcome:
        """One input."""
        path = self.folder / "input"
        what, whole, is_damage = self.make(rng, path)
        outcome = judged(path, whole, what, rules(), damage=is_damage)
        if rng.random() < 0.05:
            used(rng, path, self.folder / "elsewhere")
            shutil.rmtree(self.folder / "elsewhere", ignore_errors=True)
        return outcome

    def make(self, rng: Random, path: Path) -> tuple[str, Sound, bool]:
        """Write an input; what was done, to what, and whether checksums cover it."""
        while True:
            seed, whole = rng.choice(self.seeds)
            shutil.rmtree(path, ignore_errors=True)
            shutil.copytree(seed, path)
            act = _bomb if rng.random() < 0.01 else rng.choice(_ACTS)
            try:
                what, is_damage = act(rng, path)
            except (pa.ArrowException, ValueError, OverflowError, RecursionError):
                continue  # what cannot be written is no input
            return f"{act.__name__.strip('_')}: {what}", whole, is_damage


def _edges(data: bytes) -> list[int]:
    """Where pages and columns begin, and the footer."""
    found = [4, len(data) - 8 - int.from_bytes(data[-8:-4], "little"), len(data) - 8, len(data)]
    metadata = pq.ParquetFile(pa.BufferReader(data)).metadata
    for g in range(metadata.num_row_groups):
        for c in range(metadata.num_columns):
            column = metadata.row_group(g).column(c)
            found += [
                column.data_page_offset,
                column.data_page_offset + column.total_compressed_size,
            ]
            if column.has_dictionary_page:
                found.append(column.dictionary_page_offset)
    return found


def _bytes(rng: Random, dataset: Path) -> tuple[str, bool]:
    """Bytes of a file, at edges of pages and anywhere."""
    file = some_file(rng, dataset)
    data = file.read_bytes()
    edges = _edges(data) if file.suffix == ".parquet" else []
    data, what = damaged(rng, data, edges)
    if rng.random() < 0.15:
        data, more = damaged(rng, data, edges)
        what = f"{what}, {more}"
    file.write_bytes(data)
    return f"{file.parent.name}, {what}", True


def _rewrite(file: Path, table: pa.Table, name: str) -> None:
    kind = "meta/episodes" if name == "episodes" else name
    try:
        pq.write_table(table, file, **write_options(kind))
    except (pa.ArrowException, OSError):  # encodings that do not fit other types
        pq.write_table(table, file)


def _cells(rng: Random, dataset: Path) -> tuple[str, bool]:
    """One cell of a table; what cannot be is damage, what can be makes another trace."""
    file = some_table(rng, dataset)
    table = pq.read_table(file)
    if not len(table):
        return "nothing there", True
    column = rng.choice(table.column_names)
    values = table[column].to_pylist()
    row = rng.randrange(len(values))
    if column in JSON_COLUMNS and isinstance(values[row], str) and rng.random() < 0.9:
        tree, what = altered(rng, json.loads(values[row]))
        try:
            values[row] = json.dumps(tree)
        except (ValueError, RecursionError):
            values[row] = "{"
        if rng.random() < 0.05:
            values[row] = "[" * 100_000
        values[row] = values[row].encode("utf-8", "replace").decode()
    else:
        values[row] = strange(rng, values[row])
        what = f"{str(values[row])[:30]!r}"
    for kind in (table.schema.field(column).type, None):
        try:
            array = pa.array(values, kind)
            break
        except (pa.ArrowException, ValueError, TypeError, OverflowError, UnicodeError):
            array = None
    if array is None:
        array = pa.array([0] * len(values))
        what = "numbers"
    value = values[row]
    is_damage = (
        isinstance(value, float) and not math.isfinite(value) and file.parent.name != "episodes"
    )
    index = table.column_names.index(column)
    _rewrite(file, table.set_column(index, column, array), file.parent.name)
    return f"{file.parent.name}.{column}[{row}] {what}", is_damage


def _rows(rng: Random, dataset: Path) -> tuple[str, bool]:
    """Rows gone, twice, exchanged or of another frame: the trace is not whole."""
    file = dataset / rng.choice(("bodies", "frames", "contacts")) / "episode-000000.parquet"
    table = pq.read_table(file)
    rows, at = len(table), rng.randrange(len(table))
    act = rng.choice(("gone", "twice", "cut", "many", "frame"))
    if act == "gone":
        table = pa.concat_tables([table[:at], table[at + 1 :]])
    elif act == "twice":
        table = pa.concat_tables([table[: at + 1], table[at:]])
    elif act == "cut":
        table = table[:at]
    elif act == "many":
        table = pa.concat_tables([table] * rng.choice((2, 50)))
    else:
        frames = table["frame_index"].to_pylist()
        frames[at] = rng.choice((-1, frames[at] + 1, 2**31 - 1, 0, 10**6))
        index = table.column_names.index("frame_index")
        table = table.set_column(index, "frame_index", pa.array(frames, pa.int32()))
    _rewrite(file, table, file.parent.name)
    # a contact more or less, or in another frame, is no damage that the bytes could tell
    return (
        f"{file.parent.name} row {at} of {rows} {act}",
        file.parent.name != "contacts" or act != "frame",
    )


def _names(rng: Random, dataset: Path) -> tuple[str, bool]:
    """Bodies in tables that the header does not know."""
    table_name = rng.choice(("bodies", "contacts", "geometry"))
    file = dataset / table_name / "episode-000000.parquet"
    table = pq.read_table(file)
    column = rng.choice([n for n in ("body", "body1", "body2") if n in table.column_names])
    values = table[column].to_pylist()
    old, new = rng.choice(values), rng.choice((*NAMES, None))
    kept = rng.random() < 0.5
    values = [new if v == old and not (kept and i % 2) else v for i, v in enumerate(values)]
    values = [v.encode("utf-8", "replace").decode() if v else v for v in values]
    index = table.column_names.index(column)
    _rewrite(file, table.set_column(index, column, pa.array(values, pa.string())), table_name)
    return f"{table_name}.{column} {old!r} = {str(new)[:20]!r}", new not in ("table", "cube")


def _columns(rng: Random, dataset: Path) -> tuple[str, bool]:
    """A column of another kind, gone, or there twice."""
    file = some_table(rng, dataset)
    table = pq.read_table(file)
    name = rng.choice(table.column_names)
    index = table.column_names.index(name)
    act = rng.choice(("gone", "twice", "text", "double", "list", "null", "wide", "bytes", "dates"))
    rows = len(table)
    if act == "gone":
        table = table.drop_columns([name])
    elif act == "twice":
        table = table.append_column(name, table[name])
    elif act in ("double", "wide"):
        try:
            table = table.set_column(
                index, name, table[name].cast(pa.float64() if act == "double" else pa.int64())
            )
        except (pa.ArrowException, ValueError):
            act = "none"
    else:
        other = {
            "text": pa.array(["x"] * rows),
            "list": pa.array([[1.0, 2.0]] * rows),
            "null": pa.nulls(rows),
            "bytes": pa.array([b"\xff"] * rows),
            "dates": pa.array([0] * rows, pa.timestamp("ms")),
        }[act]
        table = table.set_column(index, name, other)
    _rewrite(file, table, file.parent.name)
    return f"{file.parent.name}.{name} {act}", False


def _bomb(rng: Random, dataset: Path) -> tuple[str, bool]:
    """Few bytes that stand for many rows."""
    table_name = rng.choice(("bodies", "contacts", "frames", "geometry"))
    file = dataset / table_name / "episode-000000.parquet"
    table = pq.read_table(file)
    many = 10 ** rng.choice((4, 4, 5, 6) if table_name != "bodies" else (4, 5))
    grown = table[:1].take(pa.array(np.zeros(many, np.int32)))
    compression = rng.choice(("lz4", "zstd", "snappy", "gzip"))
    pq.write_table(grown, file, compression=compression, use_dictionary=rng.random() < 0.5)
    return f"{table_name}: {many} rows, {compression}", True


def _files(rng: Random, dataset: Path) -> tuple[str, bool]:
    """Other things in the place of a file."""
    file = some_file(rng, dataset)
    act = rng.choice(
        ("gone", "folder", "pipe", "zero", "outside", "loop", "other", "empty", "strange")
    )
    if act == "strange":
        name = (
            os.fsencode(dataset) + b"/" + rng.choice((b"\xff.mcap", b"a\nb.mcap", b"\xed\xa0\x80"))
        )
        with Path(os.fsdecode(name)).open("wb") as stream:
            stream.write(rng.choice((b"", b"\x89MCAP0\r\n", b"PAR1")))
        return "a strange name", False
    target = some_table(rng, dataset)
    other = target.read_bytes()
    file.unlink()
    if act == "folder":
        file.mkdir()
    elif act == "pipe":
        os.mkfifo(file)
    elif act == "zero":
        file.symlink_to("/dev/zero")
    elif act == "outside":
        file.symlink_to("/etc/passwd")
    elif act == "loop":
        file.symlink_to(file)
    elif act == "other":
        file.write_bytes(other)
    elif act == "empty":
        file.write_bytes(b"")
    return f"{file.parent.name} {act}", True


def _headers(rng: Random, dataset: Path) -> tuple[str, bool]:
    """Names of files in the row of the episode that lead elsewhere, and lengths that are not."""
    file = next((dataset / "meta/episodes").iterdir())
    table = pq.read_table(file)
    row = table.to_pylist()[0]
    act = rng.choice(("file", "attachments", "length", "contacts", "states", "index", "rows"))
    if act == "file":
        row["file"] = rng.choice((*NAMES, "../bodies/episode-000000", "/dev/zero"))
    elif act == "attachments":
        where = rng.choice((*NAMES, "/dev/zero", "../../../../../../etc/passwd"))
        row["attachments"] = json.dumps({"task.toml": where})
    elif act in ("length", "contacts", "states"):
        row[act] = rng.choice([n for n in NUMBERS if isinstance(n, int) and abs(n) < 2**31])
    elif act == "index":
        row["episode_index"] = rng.choice((-1, 1, 2**31 - 1))
    rows = [row] * (rng.choice((0, 2, 1000)) if act == "rows" else 1)
    row["file"] = row["file"].encode("utf-8", "replace").decode()
    table = pa.Table.from_pylist(rows, schema("meta/episodes"))
    pq.write_table(table, file, **write_options("meta/episodes"))
    return f"{act} {str(row.get(act))[:30]}", act != "states"


def _unsealed(rng: Random, dataset: Path) -> tuple[str, bool]:
    """Remove content hash and digests from the row, so that no checksum reports the change."""
    file = next((dataset / "meta/episodes").iterdir())
    row = pq.read_table(file).to_pylist()[0] | {"content_hash": None, "digests": None}
    _rewrite(file, pa.Table.from_pylist([row], schema("meta/episodes")), "episodes")
    act = rng.choice((_numbers, _numbers, _numbers, _cells, _rows, _names, _columns, _meshes))
    return f"{act.__name__.strip('_')}: {act(rng, dataset)[0]}", False


def _numbers(rng: Random, dataset: Path) -> tuple[str, bool]:
    """A stretch of a column of numbers is not there, or says something else."""
    file = dataset / rng.choice(("bodies", "contacts", "frames")) / "episode-000000.parquet"
    table = pq.read_table(file)
    names = [name for name in table.column_names if pa.types.is_floating(table[name].type)]
    if not names:
        return "no numbers", False
    name = rng.choice(names)
    values = table[name].to_numpy().copy()
    first = rng.randrange(len(values))
    last = first + 1 + int(rng.random() ** 3 * len(values))
    value = rng.choice((np.nan, np.nan, np.nan, 0.0, np.inf, 1e9, rng.gauss(0, 1)))
    values[first:last] = value
    index = table.column_names.index(name)
    _rewrite(file, table.set_column(index, name, pa.array(values)), file.parent.name)
    return f"{file.parent.name}.{name}[{first}:{last}] = {value:g}", False


def _meshes(rng: Random, dataset: Path) -> tuple[str, bool]:
    """Assets exchanged, and geometry that names others."""
    file = dataset / "geometry" / "episode-000000.parquet"
    rows = pq.read_table(file).to_pylist()
    geom = rng.choice(rows)
    act = rng.choice(("mesh", "kind", "size", "position", "orientation", "geom"))
    if act == "mesh":
        geom["mesh"] = rng.choice((*NAMES, "../../../etc/hosts", "/dev/zero", "0" * 64))
        geom["mesh"] = geom["mesh"].encode("utf-8", "replace").decode()
        geom["kind"] = "convex_mesh"
    elif act == "kind":
        geom["kind"] = rng.choice(("convex_mesh", "mesh", "sphere", "capsule", "plane", "box", "x"))
    elif act == "geom":
        geom["geom"] = rng.choice((-1, 0, 5, 2**15))
    else:
        width = {"position": 3, "orientation": 4, "size": len(geom["size"])}[act]
        pool = [float(n) for n in NUMBERS if isinstance(n, float) or abs(n) < 10**6]
        geom[act] = [rng.choice(pool) for _ in range(width + rng.choice((0, 0, 0, 1, -1)))]
    table = pa.Table.from_pylist(rows, schema("geometry"))
    pq.write_table(table, file, **write_options("geometry"))
    return f"{geom['body']}.{act} = {str(geom[act])[:60]}", False


_ACTS = (
    _bytes, _bytes, _bytes, _bytes, _bytes, _bytes, footer, footer, footer, page, page, _cells, _cells, _cells, _rows,
    _names, _columns, _files, _headers, _meshes, _numbers, _unsealed, _unsealed, _unsealed,
    _unsealed,
)  # fmt: skip
