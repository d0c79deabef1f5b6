"""Dead, slow and mad servers: a plain message each, and no failure of the policy."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from served import HOME, blind, saying, seen  # noqa: F401 - blind is a fixture

from safestage_eval.formats import load
from simulate.clients.message_arrays import pack
from simulate.policies.policy_names import policy_named
from simulate.policy import PolicyError
from simulate.record.jobs import plan, record, recorded_ids
from simulate.tasks.task import task_named

pytestmark = pytest.mark.simulate

STILL = np.tile(np.append(HOME, 0.0), (15, 1)).astype(np.float32)
GOOD = pack({"actions": STILL})
TASK = "fsh_orange_on_plate"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def ask(url: str, protocol: str = "openpi", options: str = "") -> Any:
    policy = policy_named(f"{protocol}:{url}?wait=0.5&{options}")
    policy.reset(TASK, "do it")
    try:
        return policy.act(seen())
    finally:
        policy.close()  # type: ignore[attr-defined]


def changed(**put: Any) -> bytes:
    actions = STILL.copy()
    for row, value in put.items():
        actions[int(row[1:])] = value
    return pack({"actions": actions})


@pytest.mark.parametrize("protocol", ["openpi:ws", "dreamzero:ws", "cosmos3:ws", "groot:tcp"])
def test_nobody_there(protocol: str) -> None:
    name, _, scheme = protocol.partition(":")
    start = time.monotonic()
    with pytest.raises(PolicyError, match=r"no policy server answers|no answer within"):
        ask(f"{scheme}://127.0.0.1:{free_port()}", name)
    assert time.monotonic() - start < 20


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (pack({"actions": STILL[:10]}), r"10 actions, and 15 are to be played.*horizon=10"),
        (pack({"actions": STILL[:, :7]}), r"shape \(15, 7\), not \(N, 8\)"),
        (changed(r3=np.nan), "action 3 of its answer is not finite"),
        (changed(r0=np.inf), "action 0 of its answer is not finite"),
        (pack({"action": STILL}), "not one of openpi's: no 'actions'"),
        (b"\xc1", "not a message of MessagePack"),
        (
            "Traceback (most recent call last):\n  File …\nRuntimeError: out of memory\n",
            "says: Runtime",
        ),
    ],
)
def test_nonsense(answer: bytes | str, said: str) -> None:
    with saying(lambda _n: answer) as (url, _), pytest.raises(PolicyError, match=said) as caught:
        ask(url)
    assert url in str(caught.value)
    assert "\n" not in str(caught.value)


def test_too_slow() -> None:
    def later(_n: int) -> bytes:
        time.sleep(0.6)
        return GOOD

    with saying(later) as (url, _):
        with pytest.raises(PolicyError, match=r"no answer within 0.1 s.*timeout=SECONDS"):
            ask(url, options="timeout=0.1")
        assert ask(url, options="timeout=30").shape == (15, 8)


def test_what_a_server_remembered_is_lost_with_the_connection() -> None:
    rows = pack(np.tile(np.append(HOME, 0.0), (24, 1)))
    with saying(lambda _n: rows) as (url, server):
        policy = policy_named(f"dreamzero:{url}?wait=5")
        policy.reset(TASK, "")
        policy.act(seen())
        for connection in list(server._open):
            connection.socket.shutdown(socket.SHUT_RDWR)
        with pytest.raises(PolicyError, match="remembered of the episode is lost"):
            policy.act(seen())
        policy.close()  # type: ignore[attr-defined]


@pytest.mark.usefixtures("blind")
def test_a_campaign_goes_on_and_is_taken_up_again(tmp_path: Path) -> None:
    """The server dies in the second of three rollouts; another one comes, and fills the gaps."""
    port, calls = free_port(), 0

    def dies(_n: int) -> bytes | str:
        nonlocal calls
        calls += 1
        return GOOD if calls != 4 else "RuntimeError: CUDA error"

    def run(answer: Callable[[int], bytes | str]) -> list[Any]:
        from served import Says

        from simulate.servers.websocket import WebsocketServer

        with WebsocketServer(lambda: Says(answer), port=port):  # type: ignore[arg-type,return-value]
            return list(record(todo, tmp_path))

    address = f"openpi:ws://127.0.0.1:{port}?wait=0.5&name=model"
    todo = plan([task_named(TASK)], [address], [0, 1, 2], horizon=1.5)
    first = run(dies)  # two requests per rollout
    assert ["CUDA error" in o.problem for o in first] == [False, True, False]
    whole = {first[0].episode_id, first[2].episode_id}
    assert recorded_ids(tmp_path) == whole
    broken = load(tmp_path, episode=first[1].episode_id)
    assert broken.header.termination == "error"
    assert broken.header.success is None
    assert "CUDA error" in broken.header.notes[-1]
    assert len(broken) == 15 * 8, "the first answer was played"
    nobody = list(record(todo, tmp_path))
    assert [o.skipped for o in nobody] == [True, False, True]
    assert "no policy server answers" in nobody[1].problem
    assert recorded_ids(tmp_path) == whole
    second = run(lambda _n: GOOD)
    assert [o.skipped for o in second] == [True, False, True]
    assert recorded_ids(tmp_path) == whole | {second[1].episode_id}
    assert second[1].episode_id == first[1].episode_id
