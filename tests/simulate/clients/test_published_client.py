"""Our messages are byte for byte those of the published packages (recorded with openpi-client 0.1.2)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from served import picture, seen

from simulate.clients.address import address_of
from simulate.clients.conversation import messages
from simulate.clients.message_arrays import Style, pack, unpack
from simulate.policies.policy_names import policy_named

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
    return next(what for name, what in messages(SAID) if name == who)


def test_a_request_is_what_the_published_client_sends() -> None:
    images = {"exterior_left": picture(0), "wrist": picture(60)}
    request = address_of("openpi:talk:x").dialect.request(seen(images=images), "")
    assert pack(request) == said("asked")


def test_an_answer_of_the_published_package_is_understood() -> None:
    policy = policy_named(f"openpi:talk:{SAID}")
    policy.reset("", "")
    expected = ACTIONS.astype(float)
    expected[:, 7] = expected[:, 7] > 0.5
    assert np.array_equal(policy.act(seen()), expected)


@pytest.mark.parametrize("style", ["openpi", "nd"])
def test_arrays_are_written_as_the_published_packages_do(style: Style) -> None:
    assert pack(ARRAYS, style) == said(style)
    found = unpack(said(style))
    for name, array in ARRAYS.items():
        assert np.array_equal(found[name], array), name
        assert found[name].dtype == array.dtype, name
