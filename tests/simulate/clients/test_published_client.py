"""Our messages are byte for byte those of the published packages (recorded with openpi-client 0.1.2)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest
import zstandard
from served import picture, seen

from simulate.clients.address import dialect_of
from simulate.clients.message_arrays import Style, pack, unpack

SAID = Path(__file__).with_name("openpi_client.talk")
ACTIONS = (np.arange(120).reshape(15, 8) / 64).astype(np.float32)
ARRAYS: dict[str, Any] = {
    "bytes": np.arange(6, dtype=np.uint8).reshape(1, 2, 3),
    "floats": np.linspace(0, 1, 7, dtype=np.float32),
    "doubles": np.array(2.5),
    "flags": np.array([True, False]),
    "scalar": np.float32(0.25),
}


def said(who: str) -> Any:
    with SAID.open("rb") as file, zstandard.ZstdDecompressor().stream_reader(file) as stream:
        return dict(msgpack.Unpacker(stream, max_buffer_size=0))[who]


def test_a_request_is_what_the_published_client_sends() -> None:
    images = {"exterior_left": picture(0), "wrist": picture(60)}
    request = dialect_of("openpi").request(seen(images=images), "")
    assert pack(request) == said("asked")


def test_an_answer_of_the_published_package_is_understood() -> None:
    expected = ACTIONS.astype(float)
    expected[:, 7] = expected[:, 7] > 0.5
    assert np.array_equal(dialect_of("openpi").actions(unpack(said("answered")), seen()), expected)


@pytest.mark.parametrize("style", ["openpi", "nd"])
def test_arrays_are_written_as_the_published_packages_do(style: Style) -> None:
    assert pack(ARRAYS, style) == said(style)
    found = unpack(said(style))
    for name, array in ARRAYS.items():
        assert np.array_equal(found[name], array), name
        assert found[name].dtype == array.dtype, name
