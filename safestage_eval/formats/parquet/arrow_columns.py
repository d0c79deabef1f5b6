"""Columns of Arrow tables as NumPy arrays, and back, as ``arrow_tables`` describes them.

``where`` is what messages say of the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import DTypeLike, NDArray

from safestage_eval.errors import TraceError

from .arrow_tables import columns_of, parts_of, schema

_DTYPES: dict[str, np.dtype[Any]] = {"float": np.dtype(np.float32), "double": np.dtype(np.float64)}


class Words(NamedTuple):
    """A column of names: (N,) places in a list of them."""

    places: NDArray[np.integer]
    names: list[str]

    def among(self, index: Mapping[str, int], column: str, where: str) -> NDArray[np.int16]:
        """Return (N,) places in an index of bodies. Raises TraceError for a name that is not in it."""
        places = np.array([index.get(name, -1) for name in self.names], np.int16)
        found = places[self.places] if len(self.places) else np.zeros(0, np.int16)
        if len(found) and found.min() < 0:
            stranger = self.names[self.places[np.argmin(found)]]
            allowed = ", ".join(index)
            raise TraceError(where, f"{column} names {stranger!r}, which is no body.", allowed)
        return found


def to_table(table: str, columns: Mapping[str, Any]) -> pa.Table:
    """Return arrays, keyed as ``arrays`` returns them, as an Arrow table with the columns of ``table``."""
    stored: dict[str, Any] = {}
    for name, parts in parts_of(table).items():
        values = columns[name]
        if isinstance(values, Words):
            names = pa.array(values.names, pa.string())
            stored[name] = pa.DictionaryArray.from_arrays(values.places.astype(np.int16), names)
        elif len(parts) > 1:
            stored |= {p: np.ascontiguousarray(values[:, i]) for i, p in enumerate(parts)}
        elif columns_of(table)[name].type.startswith("list"):
            offsets = np.arange(len(values) + 1, dtype=np.int32) * values.shape[1]
            stored[name] = pa.ListArray.from_arrays(offsets, np.ascontiguousarray(values).ravel())
        else:
            stored[name] = values
    described = schema(table)
    return pa.table([stored[name] for name in described.names], described)


def arrays(rows: pa.Table, table: str, where: str) -> dict[str, Any]:
    """Return the columns of numbers and names of a table.

    Returns: name → (N,) numbers, (N, 3) or (N, 4) vectors, (N, W) lists, or ``Words``.

    Raises:
        TraceError: a column holds something else.
    """
    found: dict[str, Any] = {}
    for name, parts in parts_of(table).items():
        kind = columns_of(table)[parts[0]].type
        if kind == "dictionary":
            found[name] = _words(rows[name], name, where)
        elif kind.startswith("list"):
            found[name] = _lists(rows, name, _DTYPES[kind[5:-1]], where)
        elif len(parts) == 1:
            found[name] = numbers(rows, name, _DTYPES.get(kind) or np.dtype(kind), where)
        else:
            found[name] = vectors = np.empty((len(rows), len(parts)), np.float32)
            for i, part in enumerate(parts):
                vectors[:, i] = numbers(rows, part, np.float32, where)
    return found


def records(rows: pa.Table, table: str, where: str) -> list[dict[str, Any]]:
    """Return rows as Python values; those with the same text share it.

    What is no UTF-8 in a text becomes halves of characters, which ``demand_text`` refuses.

    Raises:
        TraceError: a column is of another kind than described.
    """
    for name, column in zip(rows.column_names, rows.columns, strict=True):
        wanted = schema(table).field(name).type
        if column.null_count < len(column) and _kind(column.type) != _kind(wanted):
            raise TraceError(where, f"the column {name!r} holds {column.type}.", f"{wanted}")
    values = [_pylist(column) for column in rows.columns]
    return [dict(zip(rows.column_names, row, strict=True)) for row in zip(*values, strict=True)]


def numbers(rows: pa.Table, column: str, dtype: DTypeLike, where: str) -> NDArray[Any]:
    """Return a column of numbers as (N,) of dtype. Raises TraceError where it holds anything else."""
    held, wanted = rows[column].type, np.dtype(dtype)
    if not _is_number(held):
        raise TraceError(where, f"the column {column!r} holds {held}.", "numbers")
    parts = [_raw(chunk) for chunk in rows[column].chunks] or [np.zeros(0, wanted)]
    values = parts[0] if len(parts) == 1 else np.concatenate(parts)
    if values.dtype == wanted or not len(values):
        return values.astype(wanted, copy=False)
    if wanted.kind in "iu" and values.dtype.kind == "f":
        raise TraceError(where, f"the column {column!r} has gaps or fractions.", f"{wanted}")
    with np.errstate(over="ignore"):
        cast = values.astype(wanted)
    if wanted.kind in "iu" and (cast != values).any():
        raise TraceError(where, f"the column {column!r} has numbers that are none.", f"{wanted}")
    return cast


def _lists(rows: pa.Table, column: str, dtype: np.dtype[Any], where: str) -> NDArray[Any]:
    """A column of lists of equal length as (N, W)."""
    kind = rows[column].type
    many = pa.types.is_list(kind) or pa.types.is_large_list(kind)
    if len(rows) and not (many and _is_number(kind.value_type)):
        raise TraceError(where, f"the column {column!r} holds {kind}.", "number lists")
    widths, flat = set[int](), [np.zeros(0, dtype)]
    for chunk in filter(len, rows[column].chunks):
        offsets = _raw(chunk.offsets)
        steps = np.diff(offsets)
        widths |= {int(steps[0])} if (steps == steps[0]).all() else set(steps.tolist())
        if chunk.null_count:
            widths.add(0)
        flat.append(_raw(chunk.values.slice(offsets[0], offsets[-1] - offsets[0])))
    if len(widths) > 1 or rows[column].null_count:
        raise TraceError(
            where,
            f"the rows of {column!r} differ in length: {sorted(widths)}.",
            "as many values in every frame; empty lists where there is nothing",
        )
    values = flat[1] if len(flat) == 2 else np.concatenate(flat)
    return np.asarray(values, dtype).reshape(len(rows), widths.pop() if widths else 0)


def _words(column: pa.ChunkedArray, name: str, where: str) -> Words:
    """A column of names; their dictionaries are sound (``demand_words``)."""
    if _kind(column.type) != "text":
        raise TraceError(where, f"the column {name!r} holds {column.type}.", "names")
    if column.null_count:
        raise TraceError(where, f"{name} is empty in {column.null_count} rows")
    numbered: dict[str, int] = {}
    parts = [np.zeros(0, np.intp)]
    for chunk in filter(len, column.chunks):
        words = chunk if isinstance(chunk, pa.DictionaryArray) else chunk.dictionary_encode()
        names = words.dictionary.to_pylist()
        places = np.array([numbered.setdefault(n, len(numbered)) for n in names], np.intp)
        parts.append(places[_raw(words.indices)])
    return Words(parts[1] if len(parts) == 2 else np.concatenate(parts), list(numbered))


def demand_words(words: pa.DictionaryArray, column: str, where: str) -> None:
    """Raise TraceError where rows refer to words that their dictionary does not have."""
    used: Any = words.indices
    if used.null_count:
        used = np.array([place for place in used.to_pylist() if place is not None])
    else:
        used = np.from_dlpack(used)
    there = len(words.dictionary)
    if len(used) and not 0 <= used.min() <= used.max() < there:
        raise TraceError(
            where,
            f"{column} refers to names {used.min()} to {used.max()} of its dictionary, "
            f"which has {there}.",
            f"0 to {there - 1}" if there else "",
            "copy the dataset again",
        )


def _pylist(column: pa.ChunkedArray) -> list[Any]:
    values: list[Any] = []
    for chunk in column.chunks:
        if isinstance(chunk, pa.DictionaryArray):
            words = _texts(chunk.dictionary)
            values += [None if code is None else words[code] for code in chunk.indices.to_pylist()]
        else:
            values += _texts(chunk)
    return values


def _texts(array: pa.Array) -> list[Any]:
    try:
        return list(array.to_pylist())
    except UnicodeDecodeError:
        raw = array.view(pa.large_binary() if pa.types.is_large_string(array.type) else pa.binary())
        return [t if t is None else t.decode("utf-8", "surrogateescape") for t in raw.to_pylist()]


def _raw(array: pa.Array) -> NDArray[Any]:
    """The numbers of an array, NaN where one is missing; without gaps they are not copied.

    Not by ``Array.to_numpy``, which imports pandas where it is installed: 50 MB and 0.3 s.
    """
    if array.null_count:
        return np.array([np.nan if value is None else value for value in array.to_pylist()])
    return np.from_dlpack(array)


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))


def is_text(kind: pa.DataType) -> bool:
    """True of a type of texts."""
    return any(
        test(kind)
        for test in (pa.types.is_string, pa.types.is_large_string, pa.types.is_string_view)
    )


def _kind(kind: pa.DataType) -> str:
    """What is the same in the files of all libraries: they differ in widths of numbers and texts."""
    if pa.types.is_dictionary(kind):
        kind = kind.value_type
    if is_text(kind):
        return "text"
    if pa.types.is_integer(kind):
        return "int"
    if pa.types.is_floating(kind):
        return "float"
    if pa.types.is_list(kind) or pa.types.is_large_list(kind):
        return f"list of {_kind(kind.value_type)}"
    return str(kind)
