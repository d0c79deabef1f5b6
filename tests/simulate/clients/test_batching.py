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
