"""Several environments of one GR00T: their requests go on as batches, the answers come back apart."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from served import Says, blind, seen  # noqa: F401 - blind is a fixture

from safestage_eval.errors import InputError
from simulate.clients.message_arrays import pack, unpack
from simulate.policies.policy_names import policy_named
from simulate.policy import PolicyError
from simulate.servers.batching import GatheringServer
from simulate.servers.serve import serve
from simulate.servers.zeromq import ZeromqServer


def echo(request: dict[str, Any]) -> list[Any]:
    """For each row actions that go to where its joints are."""
    at = request["data"]["observation"]["state.joint_position"]
    rows = np.repeat(at, 40, axis=1)
    return [{"action.joint_position": rows, "action.gripper_position": rows[..., :1]}, {}]


@contextmanager
def gathering(
    answer: Callable[[dict[str, Any]], Any], options: str = "", most: int = 16
) -> Iterator[tuple[GatheringServer, list[int]]]:
    """A server behind which another answers by rote; how many rows each of its requests had."""
    sizes: list[int] = []

    class Model(Says):
        def answered(self, message: bytes) -> bytes:
            request = unpack(message)
            if request["endpoint"] != "get_action":
                return pack({})
            sizes.append(len(request["data"]["observation"]["state.joint_position"]))
            return pack(answer(request), "nd")

    with (
        ZeromqServer(lambda: Model(lambda _n: b"")) as model,  # type: ignore[arg-type,return-value]
        serve(f"groot:{model.url}?{options}", "groot", port=0, most=most) as server,
    ):
        assert isinstance(server, GatheringServer)
        yield server, sizes


def client(
    url: str, number: int, times: int = 3, about_to: Callable[[], object] = lambda: None
) -> list[float]:
    """Asks several times; the first joint of the answers."""
    policy = policy_named(f"groot:{url}?history=0&timeout=20")
    policy.reset("task", "do it")
    try:
        found = []
        about_to()
        for turn in range(times):
            joints = np.full(7, number + turn / 10)
            found.append(float(policy.act(seen(joint_position=joints))[0, 0]))
        return found
    finally:
        policy.close()  # type: ignore[attr-defined]


def test_requests_that_wait_go_on_together_and_everyone_gets_his_own() -> None:
    ready = threading.Semaphore(0)

    def slowly_at_first(request: dict[str, Any]) -> Any:
        if len(sizes) == 1:
            for _ in range(6):
                ready.acquire(timeout=30)
            time.sleep(2.0)
        return echo(request)

    with gathering(slowly_at_first) as (server, sizes), ThreadPoolExecutor(6) as pool:
        found = [*pool.map(lambda n: client(server.url, n, 3, ready.release), range(6))]
    for number, answer in enumerate(found):
        assert answer == pytest.approx([number, number + 0.1, number + 0.2])
    assert sum(sizes) == 18
    assert max(sizes) >= 4, sizes
    assert sum(n * times for n, times in server.batches.items()) == 18


def test_no_batch_is_larger_than_is_said() -> None:
    def slowly(request: dict[str, Any]) -> Any:
        time.sleep(0.05)
        return echo(request)

    with gathering(slowly, most=2) as (server, sizes), ThreadPoolExecutor(5) as pool:
        list(pool.map(lambda n: client(server.url, n), range(5)))
    assert max(sizes) == 2
    assert sum(sizes) == 15


def test_one_bad_observation_is_not_the_others_trouble() -> None:
    first = threading.Event()

    def picky(request: dict[str, Any]) -> Any:
        if not first.is_set():
            first.set()
            time.sleep(0.3)  # the others gather meanwhile
        if (request["data"]["observation"]["state.joint_position"] > 90).any():
            return {"error": "out of range"}
        return echo(request)

    with gathering(picky) as (server, _), ThreadPoolExecutor(4) as pool:
        good = [pool.submit(client, server.url, n, 1) for n in range(3)]
        first.wait(5)
        bad = pool.submit(client, server.url, 99, 1)
        with pytest.raises(PolicyError, match="the server says: out of range"):
            bad.result()
        assert [task.result() for task in good] == [[0.0], [1.0], [2.0]]


def test_a_model_that_is_gone_is_told_to_all() -> None:
    with (
        serve("groot:tcp://127.0.0.1:1?timeout=0.2", "groot", port=0) as server,
        pytest.raises(PolicyError, match=r"tcp://127\.0\.0\.1:1: the server gave no answer"),
    ):
        client(server.url, 0)


def test_only_groot_is_gathered() -> None:
    for policy, protocol in (("openpi:ws://a", "openpi"), ("groot:tcp://a", "openpi")):
        with pytest.raises(InputError, match="is served already"):
            serve(policy, protocol, port=0)


@pytest.mark.slow
@pytest.mark.simulate
@pytest.mark.usefixtures("blind")
def test_environments_in_batches_are_judged_as_when_recorded_directly() -> None:
    """Two of them are of the same task: each row of a batch finds its own world all the same."""
    from test_loop import rolled_as_recorded

    tasks = ("fsh_orange_on_plate", "ish_coffee_can_under_bottle", "fsh_orange_on_plate")
    with (
        serve("reference:unsafe", "groot", port=0) as model,
        serve(f"groot:{model.url}", "groot", port=0) as server,
        ThreadPoolExecutor(3) as pool,
    ):
        address = f"groot:{server.url}?name=model&timeout=300"
        list(pool.map(lambda task: rolled_as_recorded(task, "unsafe", address), tasks))
    assert isinstance(server, GatheringServer)
    assert set(server.batches) >= {2}, "they met"
