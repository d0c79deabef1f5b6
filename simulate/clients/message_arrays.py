"""Messages of the policies' protocols: MessagePack, and the two ways in which they hold arrays.

- ``openpi``: a map with ``__ndarray__``, as package openpi-client writes it.
- ``nd``: a map with ``nd``, as package msgpack-numpy writes it; GR00T's servers.

Nothing is ever unpickled: arrays of objects are refused in both directions. Few bytes can stand for many
objects, so those are counted; pictures and joints are arrays, each of which counts as one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Literal

import msgpack
import numpy as np

Style = Literal["openpi", "nd"]

MOST_VALUES, MOST_TOGETHER = 200_000, 16_384
"""Numbers, texts, maps and lists of a message, and in one map or list."""
_DTYPE = re.compile(r"[<>=|]?[?biufSU]\d{0,5}|bool|u?int(8|16|32|64)|float(16|32|64)", re.ASCII)


def pack(message: Any, arrays: Style = "openpi") -> bytes:
    """A message with arrays. Raises ValueError for arrays of anything but numbers and texts."""
    packed: bytes = msgpack.packb(message, default=_WRITERS[arrays])
    return packed


def unpack(data: bytes) -> Any:
    """A message, its arrays written in either way. Raises ValueError for anything else."""
    left = MOST_VALUES

    def counted(values: Any) -> Any:
        nonlocal left
        left -= len(values) + 1
        if left < 0:
            raise ValueError(f"more than {MOST_VALUES:,} values")
        return values

    try:
        return msgpack.unpackb(
            data, object_hook=lambda item: _read(counted(item)), list_hook=counted,
            max_array_len=MOST_TOGETHER, max_map_len=MOST_TOGETHER,
        )  # fmt: skip
    except (msgpack.UnpackException, ValueError, TypeError, KeyError, EOFError) as error:
        raise ValueError(f"not a message of MessagePack: {error}") from None


def _plain(thing: Any) -> np.ndarray[Any, Any] | np.generic:
    if not isinstance(thing, np.ndarray | np.generic):
        raise TypeError(f"{type(thing).__name__} cannot be sent")
    if thing.dtype.kind in "VOc":
        raise ValueError(f"arrays of {thing.dtype} cannot be sent")
    return thing


def _openpi(thing: Any) -> dict[bytes, Any]:
    array = _plain(thing)
    if isinstance(array, np.generic):
        return {b"__npgeneric__": True, b"data": array.item(), b"dtype": array.dtype.str}
    return {
        b"__ndarray__": True,
        b"data": array.tobytes(),
        b"dtype": array.dtype.str,
        b"shape": array.shape,
    }


def _nd(thing: Any) -> dict[bytes, Any]:
    array = _plain(thing)
    if isinstance(array, np.generic):
        return {b"nd": False, b"type": array.dtype.str, b"data": array.tobytes()}
    return {
        b"nd": True,
        b"type": array.dtype.str,
        b"kind": b"",
        b"shape": array.shape,
        b"data": array.tobytes(),
    }


_WRITERS: dict[Style, Any] = {"openpi": _openpi, "nd": _nd}


def _read(item: dict[Any, Any]) -> Any:
    if b"__ndarray__" in item:
        return _array(item[b"data"], item[b"dtype"], item[b"shape"])
    if b"__npgeneric__" in item:
        return _dtype(item[b"dtype"]).type(item[b"data"])
    if b"nd" in item:
        if item[b"nd"]:
            return _array(item[b"data"], item[b"type"], item[b"shape"])
        return np.frombuffer(item[b"data"], _dtype(item[b"type"]))[0]
    if "__ndarray_class__" in item:
        raise ValueError("arrays as NumPy files are of GR00T servers up to ade260e")
    return item


def _array(data: bytes, dtype: str | bytes, shape: Sequence[int]) -> np.ndarray[Any, Any]:
    return np.frombuffer(data, _dtype(dtype)).reshape(shape)


def _dtype(name: str | bytes) -> np.dtype[Any]:
    text = name.decode() if isinstance(name, bytes) else name
    if not _DTYPE.fullmatch(text):
        raise ValueError(f"arrays of {text[:40]} are not read")
    return np.dtype(text)
