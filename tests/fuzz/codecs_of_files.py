"""Files of every kind as trees that can be altered, and back; kept by the endings of their names.

What is written again is well formed and has the right checksums: what is wrong with it is what it says.
"""

from __future__ import annotations

import csv
import gzip
import io
import json
import sqlite3
import struct
import tomllib
import xml.etree.ElementTree as ET
import zipfile
import zlib
from collections.abc import Callable
from contextlib import closing
from typing import Any, NamedTuple

import h5py
import lz4.frame
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from rlds_sets import example, record
from strange import NAMES, Table

from safestage_eval.formats.mcap.mcap_metadata import checksum
from safestage_eval.importers.tfrecord import crc32c, parse_example


class Codec(NamedTuple):
    """Bytes to a tree of tables, lists, arrays, texts and bytes, and back."""

    read: Callable[[bytes], Any]
    write: Callable[[Any], bytes]


def codec_of(name: str) -> Codec | None:
    """The codec for a file of this name."""
    inner = name.removesuffix(".gz")
    if inner != name and (found := codec_of(inner)):
        return Codec(
            lambda data: found.read(gzip.decompress(data)),
            lambda tree: gzip.compress(found.write(tree), 1),
        )
    return next((CODECS[ending] for ending in CODECS if ending in name), None)


# ---- texts


def opened(text: Any) -> Any:
    """A text that is JSON or XML, as its tree under the name of its language."""
    if isinstance(text, str) and text[:1] in ("{", "["):
        try:
            return {"json:": json.loads(text)}
        except ValueError:
            return text
    if isinstance(text, str) and text.lstrip().startswith("<mujoco"):
        return {"xml:": _from_xml(text.encode())}
    return text


def closed(value: Any) -> Any:
    """The text of such a tree; anything else as it is."""
    if isinstance(value, dict) and value.keys() == {"json:"}:
        return json.dumps(value["json:"])
    if isinstance(value, dict) and value.keys() == {"xml:"}:
        return _to_xml(value["xml:"]).decode()
    return value


def _from_xml(data: bytes) -> dict[str, Any]:
    def tree(node: ET.Element) -> dict[str, Any]:
        return {"tag": node.tag, "with": dict(node.attrib), "in": [tree(child) for child in node]}

    return tree(ET.fromstring(data))


def _to_xml(tree: dict[str, Any]) -> bytes:
    def element(tree: dict[str, Any]) -> ET.Element:
        said = {str(key): str(value) for key, value in tree.get("with", {}).items()}
        made = ET.Element(str(tree["tag"]), said)
        made.extend(map(element, tree.get("in", ())))
        return made

    return ET.tostring(element(tree))


def toml_text(tree: Any) -> bytes:
    """A table as TOML, or what is none."""
    if not isinstance(tree, dict):
        return str(tree).encode("utf-8", "replace")
    lines = [f"{json.dumps(str(key))} = {_inline(value)}" for key, value in tree.items()]
    return "\n".join(lines).encode("utf-8", "replace")


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        pairs = (f"{json.dumps(str(k))} = {_inline(v)}" for k, v in value.items())
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    if value is None:
        return json.dumps(NAMES[3])  # TOML has no nothing
    return repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)


def _to_csv(rows: list[dict[str, Any]]) -> bytes:
    out = io.StringIO()
    writer = csv.DictWriter(out, list(dict.fromkeys(key for row in rows for key in row)))
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue().encode("utf-8", "replace")


# ---- arrays


def _from_npy(data: bytes) -> Any:
    return np.load(io.BytesIO(data), allow_pickle=False)


def _to_npy(values: Any) -> bytes:
    out = io.BytesIO()
    np.save(out, values, allow_pickle=True)
    return out.getvalue()


def _from_zip(data: bytes) -> dict[str, Any]:
    """Members by name, those of a folder together: arrays, trees of JSON, and bytes."""
    tree: dict[str, Any] = {}
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        for name in archive.namelist():
            part, (folder, _, _) = archive.read(name), name.rpartition("/")
            codec = codec_of(name)
            inner = tree.setdefault(folder + "/", {}) if folder else tree
            inner[name] = codec.read(part) if codec else part
    return tree


def _to_zip(tree: dict[str, Any]) -> bytes:
    out = io.BytesIO()

    def put(members: dict[str, Any]) -> None:
        for name, value in members.items():
            codec = codec_of(name)
            if name.endswith("/"):
                put(value)
            else:
                data = value if isinstance(value, bytes) or codec is None else codec.write(value)
                archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), data)

    with zipfile.ZipFile(out, "w") as archive:
        put(tree)
    return out.getvalue()


def _from_hdf5(data: bytes) -> dict[str, Any]:
    def tree(group: h5py.Group) -> dict[str, Any]:
        said = {"@": {key: opened(value) for key, value in group.attrs.items()}}
        inner = {
            name: tree(item) if isinstance(item, h5py.Group) else np.asarray(item[()])
            for name, item in group.items()
        }
        return said | inner

    with h5py.File(io.BytesIO(data)) as file:
        return tree(file)


def _to_hdf5(tree: dict[str, Any]) -> bytes:
    def put(group: h5py.Group, tree: dict[str, Any]) -> None:
        for name, value in tree.items():
            if name == "@":
                group.attrs.update({key: closed(said) for key, said in value.items()})
            elif isinstance(value, dict):
                put(group.create_group(name), value)
            else:
                group[name] = value

    out = io.BytesIO()
    with h5py.File(out, "w") as file:
        put(file, tree)
    return out.getvalue()


# ---- tables


def _from_parquet(data: bytes) -> Table:
    table = pq.read_table(io.BytesIO(data))
    found = Table()
    found.types = dict(zip(table.column_names, table.schema.types, strict=True))
    for name, kind in found.types.items():
        numbers = pa.types.is_floating(kind) or pa.types.is_integer(kind)
        column = table[name]
        if numbers and not column.null_count:
            found[name] = column.to_numpy().copy()
        else:
            found[name] = [opened(value) for value in column.to_pylist()]
    return found


def _to_parquet(tree: Table) -> bytes:
    def column(name: str, values: Any) -> pa.Array:
        values = values if isinstance(values, np.ndarray) else [closed(value) for value in values]
        try:
            return pa.array(values, tree.types.get(name))
        except (pa.ArrowException, TypeError, ValueError, OverflowError):
            return pa.array(values)

    sink = pa.BufferOutputStream()
    pq.write_table(pa.table({name: column(name, tree[name]) for name in tree}), sink)
    return sink.getvalue().to_pybytes()


def _from_sqlite(data: bytes) -> dict[str, Table]:
    with closing(sqlite3.connect(":memory:")) as bag:
        bag.deserialize(data)
        names = [name for (name,) in bag.execute("SELECT name FROM sqlite_master")]
        found = {}
        for name in names:
            rows = bag.execute(f'SELECT * FROM "{name}"')
            heads = [column[0] for column in rows.description]
            cells = list(zip(*rows.fetchall(), strict=True)) or [()] * len(heads)
            found[name] = Table({h: list(c) for h, c in zip(heads, cells, strict=True)})
        return found


def _to_sqlite(tree: dict[str, Table]) -> bytes:
    with closing(sqlite3.connect(":memory:")) as bag:
        for name, table in tree.items():
            heads = ", ".join(f'"{head}"' for head in table)
            bag.execute(f'CREATE TABLE "{name}"({heads})')
            marks = ", ".join("?" * len(table))
            rows = zip(*table.values(), strict=True)
            bag.executemany(f'INSERT INTO "{name}" VALUES ({marks})', rows)
        bag.commit()
        return bytes(bag.serialize())


# ---- records

MAGIC = b"\x89MCAP0\r\n"
MESSAGE, CHUNK, METADATA = 5, 6, 12
MESSAGE_HEAD = 22
"""Bytes of a message before its content."""


def _from_mcap(data: bytes) -> list[list[Any]]:
    """Records, each its kind and its content; chunks unpacked, JSON and metadata as trees."""
    return _records(data[len(MAGIC) : -len(MAGIC)])


def _records(data: bytes) -> list[list[Any]]:
    found, at = [], 0
    while at + 9 <= len(data):
        kind, size = data[at], int.from_bytes(data[at + 1 : at + 9], "little")
        found.append([kind, _content(kind, data[at + 9 : at + 9 + size])])
        at += 9 + size
    return found


def _content(kind: int, raw: bytes) -> Any:
    if kind == CHUNK:
        size = int.from_bytes(raw[28:32], "little")
        return {"records": _records(lz4.frame.decompress(raw[32 + size + 8 :]))}
    if kind == METADATA:
        name, rest = _text(raw)
        texts, rest = {}, rest[4:]
        while rest:
            key, rest = _text(rest)
            value, rest = _text(rest)
            texts[key] = opened(value)
        return {"name": name, "texts": texts}
    if kind == MESSAGE and raw[MESSAGE_HEAD : MESSAGE_HEAD + 1] == b"{":
        return {"head": raw[:MESSAGE_HEAD], "json": json.loads(raw[MESSAGE_HEAD:])}
    return raw


def _text(data: bytes) -> tuple[str, bytes]:
    size = int.from_bytes(data[:4], "little")
    return data[4 : 4 + size].decode("utf-8", "replace"), data[4 + size :]


def _to_mcap(records: list[list[Any]]) -> bytes:
    return MAGIC + _written(records) + MAGIC


def _written(records: list[list[Any]]) -> bytes:
    parts = []
    for kind, content in records:
        raw = _raw(content)
        parts.append(bytes([kind]) + struct.pack("<Q", len(raw)) + raw)
    return b"".join(parts)


def _raw(content: Any) -> bytes:
    if isinstance(content, bytes):
        return content
    if "records" in content:
        inside = _written(content["records"])
        packed = lz4.frame.compress(inside)
        head = struct.pack("<QQQI", 0, 0, len(inside), zlib.crc32(inside)) + _prefixed("lz4")
        return head + struct.pack("<Q", len(packed)) + packed
    if "texts" in content:
        texts = {key: closed(value) for key, value in content["texts"].items()}
        if "checksum" in texts:
            texts["checksum"] = checksum(texts)
        pairs = b"".join(_prefixed(key) + _prefixed(value) for key, value in texts.items())
        return _prefixed(content["name"]) + struct.pack("<I", len(pairs)) + pairs
    return content["head"] + json.dumps(content["json"]).encode()


def _prefixed(value: Any) -> bytes:
    data = str(value).encode("utf-8", "surrogatepass")
    return struct.pack("<I", len(data)) + data


def _from_tfrecord(data: bytes) -> list[Any]:
    """Examples by their features: floats, whole numbers, and texts."""
    found, at = [], 0
    while at < len(data):
        size = int.from_bytes(data[at : at + 8], "little")
        parsed = parse_example(data[at + 12 : at + 12 + size], "a record")
        found.append({name: _feature(each) for name, each in parsed.items()})
        at += size + 16
    return found


def _feature(parsed: Any) -> Any:
    for values, kind in ((parsed.float_list.value, "<f4"), (parsed.int64_list.value, "i8")):
        if len(values):
            return np.array(values, kind)
    return [value.decode("utf-8", "replace") for value in parsed.bytes_list.value]


def _to_tfrecord(records: list[Any]) -> bytes:
    return b"".join(record(example(each), crc32c) for each in records)


def _lines(data: bytes) -> list[Any]:
    return [json.loads(line) for line in data.splitlines()]


CODECS = {
    ".jsonl": Codec(_lines, lambda rows: "\n".join(map(json.dumps, rows)).encode()),
    ".json": Codec(json.loads, lambda tree: json.dumps(tree).encode()),
    ".toml": Codec(lambda data: tomllib.loads(data.decode()), toml_text),
    ".csv": Codec(lambda data: list(csv.DictReader(io.StringIO(data.decode()))), _to_csv),
    ".xml": Codec(_from_xml, _to_xml),
    ".npy": Codec(_from_npy, _to_npy),
    ".npz": Codec(_from_zip, _to_zip),
    ".zip": Codec(_from_zip, _to_zip),
    ".hdf5": Codec(_from_hdf5, _to_hdf5),
    ".h5": Codec(_from_hdf5, _to_hdf5),
    ".parquet": Codec(_from_parquet, _to_parquet),
    ".db3": Codec(_from_sqlite, _to_sqlite),
    ".mcap": Codec(_from_mcap, _to_mcap),
    ".tfrecord": Codec(_from_tfrecord, _to_tfrecord),
}
