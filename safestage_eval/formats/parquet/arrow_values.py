"""Columns of an Arrow table as arrays; ``where`` is what messages say of the file."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import DTypeLike, NDArray

from safestage_eval.errors import TraceError


def numbers(table: pa.Table, column: str, dtype: DTypeLike, where: str) -> NDArray[Any]:
    """Return a column of numbers as (rows,) array of dtype. Raises TraceError for other types."""
    parts = [raw_values(chunk) for chunk in table[column].chunks] or [np.zeros(0, dtype)]
    values = parts[0] if len(parts) == 1 else np.concatenate(parts)
    check_numbers(values, column, table[column].type, dtype, where)
    return values.astype(dtype, copy=False)


def check_numbers(
    values: NDArray[Any], column: str, held: pa.DataType, dtype: DTypeLike, where: str
) -> None:
    """Raise TraceError where the values of a column, of Arrow type ``held``, cannot become numbers of dtype."""
    kind = values.dtype.kind
    if kind not in "iuf":
        raise TraceError(where, f"the column {column!r} holds {held}.", "numbers")
    if kind == "f" and len(values) and np.dtype(dtype).kind in "iu":
        raise TraceError(where, f"the column {column!r} has gaps or fractions.", f"{dtype}")


def lists(table: pa.Table, column: str, dtype: DTypeLike, where: str) -> NDArray[Any]:
    """Return a column of lists of equal length as (rows, width). Raises TraceError for other columns."""
    chunks = [chunk for chunk in table[column].chunks if len(chunk)]
    kind = table[column].type
    many = pa.types.is_list(kind) or pa.types.is_large_list(kind)
    if chunks and not (many and _is_number(kind.value_type)):
        raise TraceError(where, f"the column {column!r} holds {kind}.", "number lists")
    widths = {int(w) for c in chunks for w in _differences(raw_values(c.offsets))}
    if len(widths) > 1 or any(chunk.null_count for chunk in chunks):
        raise TraceError(
            where,
            f"the rows of {column!r} differ in length: {sorted(widths)}.",
            "as many values in every frame; empty lists where there is nothing",
        )
    width = widths.pop() if widths else 0
    flat = [flat_values(chunk) for chunk in chunks]
    values = np.concatenate(flat) if flat else np.zeros(0)
    return np.asarray(values, dtype).reshape(len(table), width)


def _differences(offsets: NDArray[Any]) -> NDArray[Any]:
    """The different steps between offsets; mostly there is one, which is soon seen."""
    steps = np.diff(offsets)
    return steps[:1] if (steps == steps[:1]).all() else np.unique(steps)


def coded_words(table: pa.Table, column: str, where: str) -> tuple[NDArray[np.intp], list[str]]:
    """Return a column of names as (rows,) numbers, and the names that they stand for.

    Raises:
        TraceError: it holds something else, gaps, or names that its dictionary does not have.
    """
    kind = table[column].type
    word = kind.value_type if pa.types.is_dictionary(kind) else kind
    if not is_text(word):
        raise TraceError(where, f"the column {column!r} holds {kind}.", "names")
    numbers: dict[str, int] = {}
    parts = []
    for chunk in table[column].chunks:
        if chunk.null_count:
            raise TraceError(where, f"{column} is empty in {chunk.null_count} rows")
        words = chunk if isinstance(chunk, pa.DictionaryArray) else _encoded(chunk)
        names = words.dictionary.to_pylist()
        check_words(words, column, where)
        used = raw_values(words.indices)
        codes = np.array([numbers.setdefault(name, len(numbers)) for name in names], np.intp)
        parts.append(codes[used] if len(used) else np.zeros(0, np.intp))
    return np.concatenate(parts) if parts else np.zeros(0, np.intp), list(numbers)


def check_words(words: pa.DictionaryArray, column: str, where: str) -> None:
    """Raise TraceError where rows refer to words that their dictionary does not have."""
    used, there = _without_gaps(words.indices), len(words.dictionary)
    if len(used) and not 0 <= used.min() <= used.max() < there:
        raise TraceError(
            where,
            f"{column} refers to names {used.min():.0f} to {used.max():.0f} of its dictionary, "
            f"which has {there}.",
            f"0 to {there - 1}" if there else "",
            "copy the dataset again",
        )


def _without_gaps(array: pa.Array) -> NDArray[Any]:
    """Return the integers of an array that are there."""
    if not array.null_count:
        return raw_values(array)
    there, values = array.buffers()
    rows = slice(array.offset, array.offset + len(array))
    known = np.unpackbits(np.frombuffer(there, np.uint8), bitorder="little")[rows].astype(bool)
    kind = f"{'i' if pa.types.is_signed_integer(array.type) else 'u'}{array.type.bit_width // 8}"
    return np.asarray(np.frombuffer(values, kind)[rows][known])


def _encoded(chunk: pa.Array) -> pa.DictionaryArray:
    plain = pa.types.is_string(chunk.type) or pa.types.is_large_string(chunk.type)
    return (chunk if plain else chunk.cast(pa.string())).dictionary_encode()


def is_text(kind: pa.DataType) -> bool:
    """True of a type of texts."""
    tests = (pa.types.is_string, pa.types.is_large_string, pa.types.is_string_view)
    return any(test(kind) for test in tests)


def codes(table: pa.Table, column: str, index: dict[str, int], where: str) -> NDArray[np.int16]:
    """Return a column of names as (rows,) places in an index.

    Raises:
        TraceError: as ``coded_words``, and for a name that is not in the index.
    """
    numbered, names = coded_words(table, column, where)
    places = np.array([index.get(name, -1) for name in names], np.int16)
    result = places[numbered] if len(numbered) else np.zeros(0, np.int16)
    if len(result) and result.min() < 0:
        stranger = names[numbered[np.argmin(result)]]
        raise TraceError(where, f"{column} names {stranger!r}, which is no body.", ", ".join(index))
    return result


def flat_values(lists: pa.ListArray | pa.LargeListArray) -> NDArray[Any]:
    """Return what stands in lists, one after the other.

    Without what pyarrow loads to compute, which takes 30 ms or more, where no list is missing.
    """
    if lists.null_count or not len(lists):
        return raw_values(lists.flatten())
    offsets = raw_values(lists.offsets)
    return raw_values(lists.values.slice(offsets[0], offsets[-1] - offsets[0]))


def pylist(column: pa.ChunkedArray) -> list[Any]:
    """Return a column as Python values; rows with the same text share it.

    What is no UTF-8 in a text becomes halves of characters, which ``demand_text`` refuses.
    """
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


def raw_values(array: pa.Array) -> NDArray[Any]:
    """Return the values of an array; numbers without gaps are not copied.

    ``Array.to_numpy`` imports pandas, which takes 50 MB and 0.3 s.
    """
    kind = array.type
    if not _is_number(kind):
        return np.asarray(array.to_numpy(zero_copy_only=False))
    if not array.null_count:
        return np.from_dlpack(array)
    bits, content = array.buffers()
    some = slice(array.offset, array.offset + len(array))
    there = np.unpackbits(np.frombuffer(bits, np.uint8), bitorder="little")[some]
    values = np.frombuffer(content, kind.to_pandas_dtype())[some]
    return np.where(
        there == 1, values, values.dtype.type(np.nan) if values.dtype.kind == "f" else np.nan
    )


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind))
