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

from safestage_eval.errors import InputError
from safestage_eval.formats import load
from simulate.clients.conversation import messages
from simulate.clients.message_arrays import pack
from simulate.policies.policy_names import policy_named
from simulate.policy import PolicyError
from simulate.record.jobs import plan, record, recorded_ids
from simulate.servers.zeromq import ZeromqServer
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


def test_a_good_answer() -> None:
    with saying(lambda _n: GOOD) as (url, _):
        assert ask(url) == pytest.approx(STILL)
        assert ask(url, options="horizon=4").shape == (4, 8)


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


def test_groots_errors_and_slowness() -> None:
    def complains(n: int) -> bytes:
        return pack({}) if n == 0 else pack({"error": "KeyError: 'video.wrist'"})

    def sleeps(n: int) -> bytes:
        time.sleep(0.3 * n)
        return pack({})

    with (
        saying(complains, ZeromqServer) as (url, _),
        pytest.raises(PolicyError, match="says: KeyE"),
    ):
        ask(url, "groot")
    with saying(sleeps, ZeromqServer) as (url, _), pytest.raises(PolicyError, match="within 0"):
        ask(url, "groot", "timeout=0.1")


def test_a_server_that_forgets_nothing_may_be_reached_again() -> None:
    with saying(lambda _n: GOOD) as (url, server):
        policy = policy_named(f"openpi:{url}?wait=5")
        policy.reset(TASK, "")
        policy.act(seen())
        for connection in list(server._open):
            connection.socket.shutdown(socket.SHUT_RDWR)
        assert policy.act(seen()).shape == (15, 8)
        policy.close()  # type: ignore[attr-defined]


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


def test_a_conversation_is_kept_and_played_back(tmp_path: Path) -> None:
    def answer(n: int) -> bytes:
        return pack({"actions": STILL + np.float32(0.01 * n)})

    with saying(answer) as (url, _):
        policy = policy_named(f"openpi:{url}?keep={tmp_path}")
        policy.reset(TASK, "")
        said = [policy.act(seen()) for _ in range(3)]
        policy.close()  # type: ignore[attr-defined]
    (file,) = tmp_path.glob("*.talk")
    assert [who for who, _ in messages(file)] == ["greeting", *["asked", "answered"] * 3]
    again = policy_named(f"openpi:talk:{file}")
    again.reset(TASK, "")
    assert all(np.array_equal(again.act(seen()), one) for one in said)
    with pytest.raises(PolicyError, match="over after 3 questions"):
        again.act(seen())


def test_what_is_no_conversation(tmp_path: Path) -> None:
    (tmp_path / "x.talk").write_bytes(b"something else")
    for name, said in (("x.talk", "not a conversation"), ("y.talk", "no such conversation")):
        with pytest.raises(InputError, match=said):
            policy_named(f"openpi:talk:{tmp_path / name}").reset(TASK, "")


def test_a_token_goes_along_in_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    from simulate.clients.message_arrays import unpack
    from simulate.clients.remote import TOKEN

    monkeypatch.setenv(TOKEN, "abc")
    asked: list[Any] = []

    def note(n: int) -> bytes:
        return pack(
            [{"joint_position": STILL[None, :, :7], "gripper_position": STILL[None, :, 7:]}, {}]
        )

    with ZeromqServer(lambda: Noting(asked, note)) as server:  # type: ignore[arg-type,return-value]
        ask(server.url, "groot", "history=0")
    assert [unpack(m)["api_token"] for m in asked] == ["abc", "abc"]


class Noting:
    def __init__(self, asked: list[bytes], answer: Callable[[int], bytes]) -> None:
        self._asked, self._answer = asked, answer

    def answered(self, message: bytes) -> bytes:
        self._asked.append(message)
        return self._answer(len(self._asked))
