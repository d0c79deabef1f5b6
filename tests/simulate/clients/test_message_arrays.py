"""Messages with arrays: what is written can be read, and nothing dangerous is."""

from __future__ import annotations

from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from simulate.clients.message_arrays import Style, pack, unpack

STYLES: tuple[Style, ...] = ("openpi", "nd")
DTYPES = npst.integer_dtypes() | npst.floating_dtypes() | npst.boolean_dtypes()


@pytest.mark.parametrize("style", STYLES)
@settings(max_examples=60, deadline=None)
@given(data=st.data())
def test_every_array_comes_back(style: Style, data: Any) -> None:
    array = data.draw(npst.arrays(DTYPES, npst.array_shapes(min_dims=0, min_side=0, max_side=4)))
    found = unpack(pack({"a": [array, "text", 3.5], "b": {"c": None}}, style))
    assert found["a"][1:] == ["text", 3.5]
    assert found["b"] == {"c": None}
    assert found["a"][0].dtype == array.dtype
    assert found["a"][0].shape == array.shape
    assert found["a"][0].tobytes() == array.tobytes()


@pytest.mark.parametrize("style", STYLES)
def test_objects_are_not_sent(style: Style) -> None:
    with pytest.raises((ValueError, TypeError)):
        pack({"a": np.array([object()])}, style)
    with pytest.raises((ValueError, TypeError)):
        pack({"a": object()}, style)


@pytest.mark.parametrize(
    "message",
    [
        b"",
        b"\xc1",
        b"\x93\x01",
        msgpack.packb({b"__ndarray__": True, b"data": b"12", b"dtype": "|O", b"shape": [1]}),
        msgpack.packb({b"__ndarray__": True, b"data": b"12", b"dtype": "<f8", b"shape": [1]}),
        msgpack.packb({b"nd": True, b"data": b"12"}),
        msgpack.packb({b"nd": True, b"type": b"O", b"kind": b"O", b"shape": [1], b"data": b"x"}),
        msgpack.packb({"__ndarray_class__": True, "as_npy": b"no"}),
    ],
)
def test_what_is_no_message_is_told(message: bytes) -> None:
    with pytest.raises(ValueError, match="not a message of MessagePack"):
        unpack(message)
