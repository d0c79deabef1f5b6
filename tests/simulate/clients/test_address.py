"""Addresses of served policies: what they say, and what is wrong with them."""

from __future__ import annotations

import pytest

from safestage_eval.errors import InputError
from simulate.clients.address import address_of, is_address
from simulate.record.jobs import plan
from simulate.tasks.task import task_named

pytestmark = pytest.mark.simulate


def test_an_address_says_where_and_how() -> None:
    found = address_of("openpi:ws://10.0.0.7:8123/x?name=pi05&horizon=8&actions=velocity&timeout=5")
    assert found.url == "ws://10.0.0.7:8123/x"
    assert found.name == "pi05"
    assert found.dialect.horizon == 8
    assert found.common.timeout == 5


@pytest.mark.parametrize(
    ("policy", "url"),
    [
        ("openpi:ws://gpu", "ws://gpu:8000"),
        ("groot:tcp://gpu", "tcp://gpu:5555"),
        ("dreamzero:wss://gpu:5000", "wss://gpu:5000"),
        ("cosmos3:ws://[::1]:8000", "ws://[::1]:8000"),
    ],
)
def test_what_is_left_out_is_the_protocols_own(policy: str, url: str) -> None:
    found = address_of(policy)
    assert found.url == url
    assert found.name == policy.partition(":")[0]
    assert found.common.timeout is None


@pytest.mark.parametrize(
    ("policy", "said"),
    [
        ("openpi:tcp://gpu:8000", r"ws://HOST:8000"),
        ("groot:ws://gpu:5555", r"tcp://HOST:5555"),
        ("openpi:", "is not where openpi is served"),
        ("openpi:ws://gpu:port", "[Pp]ort"),
        ("openpi:ws://gpu?horizont=3", "horizont.*Allowed: horizon, actions, camera, name"),
        ("openpi:ws://gpu?horizon=0", "greater than or equal to 1"),
        ("openpi:ws://gpu?actions=torque", "position"),
        ("openpi:ws://gpu?name=a/b", "name"),
        ("dreamzero:ws://gpu?second=wrist", "second"),
        ("cosmos3:ws://gpu?timeout=0", "timeout"),
    ],
)
def test_mistakes_are_told(policy: str, said: str) -> None:
    assert is_address(policy)
    with pytest.raises(InputError, match=said):
        address_of(policy)


def test_two_policies_of_one_name_are_refused() -> None:
    task = task_named("fsh_orange_on_plate")
    with pytest.raises(InputError, match=r"both are called 'openpi'.*name=NAME"):
        plan([task], ["openpi:ws://a", "openpi:ws://b"], [0])
