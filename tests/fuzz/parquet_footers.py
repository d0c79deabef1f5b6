"""Numbers, names and lists in the footers and page headers of Parquet files, with all lengths right again."""

from __future__ import annotations

from pathlib import Path
from random import Random
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import thrift_tree as thrift
from damage import HUGE


def some_file(rng: Random, dataset: Path, pattern: str = "**/*.*") -> Path:
    files = sorted(file for file in dataset.glob(pattern) if file.is_file())
    heavy = [f for f in files if f.parent.name in ("bodies", "contacts", "episodes")]
    return rng.choice(heavy or files) if rng.random() < 0.6 else rng.choice(files)


def some_table(rng: Random, dataset: Path) -> Path:
    return some_file(rng, dataset, "**/*.parquet")


def footer(rng: Random, dataset: Path) -> tuple[str, bool]:
    """A number, name, list or record in the footer, of which the length is right again."""
    file = some_table(rng, dataset)
    data = file.read_bytes()
    begin = len(data) - 8 - int.from_bytes(data[-8:-4], "little")
    tree, _ = thrift.read(data, begin)
    tree, what = _twisted(rng, tree)
    footer = thrift.write(tree)
    file.write_bytes(data[:begin] + footer + len(footer).to_bytes(4, "little") + b"PAR1")
    return f"{file.parent.name}, {what}", "number" in what


def page(rng: Random, dataset: Path) -> tuple[str, bool]:
    """A number in the header of a page, with all places behind it put right."""
    file = some_table(rng, dataset)
    data = file.read_bytes()
    begin = len(data) - 8 - int.from_bytes(data[-8:-4], "little")
    footer, _ = thrift.read(data, begin)
    metadata = pq.ParquetFile(pa.BufferReader(data)).metadata
    if not metadata.num_row_groups:
        return "no pages", True
    group = metadata.row_group(rng.randrange(metadata.num_row_groups))
    column = group.column(rng.randrange(metadata.num_columns))
    at = column.data_page_offset
    if column.has_dictionary_page and rng.random() < 0.5:
        at = column.dictionary_page_offset
    head, end = thrift.read(data, at)
    head, what = _twisted(rng, head)
    written = thrift.write(head)
    more = len(written) - (end - at)
    footer = _moved(footer, at, more)
    body = data[:at] + written + data[end:begin]
    foot = thrift.write(footer)
    file.write_bytes(body + foot + len(foot).to_bytes(4, "little") + b"PAR1")
    return f"{file.parent.name}, {what}", True


def _moved(node: thrift.Node, at: int, more: int) -> thrift.Node:
    """A footer of which all that begins behind a place has moved, and the column there grown."""
    groups = dict(node.value)[4].value[1]
    for g, group in enumerate(groups):
        fields = dict(group.value)
        chunks = fields[1].value[1]
        for c, chunk in enumerate(chunks):
            parts = dict(chunk.value)
            meta = dict(parts[3].value)
            first = min(meta[n].value for n in (9, 11) if n in meta)
            if first <= at < first + meta[7].value:
                meta[7] = meta[7]._replace(value=meta[7].value + more)
            for n in (9, 11):
                if n in meta and meta[n].value > at:
                    meta[n] = meta[n]._replace(value=meta[n].value + more)
            parts[3] = parts[3]._replace(value=sorted(meta.items()))
            chunks[c] = chunk._replace(value=sorted(parts.items()))
        groups[g] = group._replace(value=[(n, fields[n]) for n, _ in group.value])
    return node


def _twisted(rng: Random, tree: thrift.Node) -> tuple[thrift.Node, str]:
    """One value of a record replaced."""
    owners: list[tuple[list[Any], int, str]] = []

    def gather(node: thrift.Node, told: str) -> None:
        if node.kind == thrift.RECORD:
            for i, (number, field) in enumerate(node.value):
                owners.append((node.value, i, f"{told}.{number}"))
                gather(field, f"{told}.{number}")
        elif node.kind in (thrift.LIST, thrift.SET):
            items = node.value[1]
            for i, item in enumerate(items):
                owners.append((items, i, f"{told}[{i}]"))
                gather(item, f"{told}[{i}]")

    gather(tree, "")
    owner, i, place = rng.choice(owners)
    entry = owner[i]
    number, node = (None, entry) if isinstance(entry, thrift.Node) else entry
    if rng.random() < 0.15:
        if rng.random() < 0.5:
            del owner[i]
            return tree, f"{place} gone"
        owner.insert(i, entry)
        return tree, f"{place} twice"
    if node.kind in (thrift.I16, thrift.I32, thrift.I64, thrift.BYTE):
        value = rng.choice(
            (*HUGE, -1, 2, 3, 5, 6, 7, 9, node.value + 1, node.value - 1, -node.value)
        )
        new, what = node._replace(value=value), f"number {place} = {value}"
    elif node.kind == thrift.TEXT:
        text = rng.choice((b"", b"\xff\xfe", b"x" * 3000, b"position.x", b"body", node.value[:-1]))
        new, what = node._replace(value=text), f"text {place} = {text[:20]!r}"
    elif node.kind in (thrift.TRUE, thrift.FALSE):
        new, what = node._replace(kind=3 - node.kind), f"truth {place}"
    elif node.kind == thrift.RECORD:
        for _ in range(rng.choice((1, 20, 200))):
            node = thrift.Node(thrift.RECORD, [(1, node)])
        new, what = node, f"record {place} deeper"
    else:
        kind, items = node.value
        new = node._replace(value=(kind, items * rng.choice((0, 2, 30))))
        what = f"list {place} longer"
    owner[i] = new if number is None else (number, new)
    return tree, what
