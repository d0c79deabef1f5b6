"""Hostile messages to a served policy are refused or answered with an error, and the server goes on."""

from __future__ import annotations

import base64
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from typing import Any

import numpy as np
import pytest
import zmq
from served import Says, saying
from websockets.exceptions import ConnectionClosedError, InvalidStatus
from websockets.sync.client import connect

from safestage_eval._process.memory_limit import resident
from safestage_eval._serving.guard import Guard
from safestage_eval.errors import InputError
from simulate.clients.line import ZeromqLine
from simulate.clients.message_arrays import MOST_TOGETHER, MOST_VALUES, pack, unpack
from simulate.servers.websocket import WebsocketServer
from simulate.servers.zeromq import ZeromqServer

PING = pack({"endpoint": "ping"})


@contextmanager
def dealer(url: str) -> Iterator[Any]:
    """A caller that may send any number of parts."""
    context = zmq.Context()
    try:
        line = context.socket(zmq.DEALER)
        line.setsockopt(zmq.LINGER, 0)
        line.connect(url)
        yield line
    finally:
        context.destroy()


def asked(url: str, message: bytes, patience: float) -> Any:
    """The answer to one message of a caller of GR00T's."""
    with closing(ZeromqLine(url)) as line:
        return line.ask(message, patience)


@pytest.mark.parametrize(
    "parts", [[b""], [b"x"], [b"", b"a", b"b"], [b"a", b"b"], [b"a", b"b", b"c"], [b""] * 50]
)
def test_a_message_of_any_number_of_parts_is_answered_and_ends_nothing(parts: list[bytes]) -> None:
    with saying(lambda _n: b"yes", ZeromqServer) as (url, server), dealer(url) as line:
        line.send_multipart(parts)
        assert line.poll(5000)
        assert "parts" in unpack(line.recv_multipart()[-1])["error"]
        assert asked(url, PING, 5) == b"yes"
        assert server._thread.is_alive()


@pytest.mark.parametrize(
    "message", [b"", b"\xc1", b"\x93", b"\x91" * 5000, bytes(range(40, 140)), pack(None), pack([1])]
)
def test_a_message_that_is_none_is_answered_with_an_error(message: bytes) -> None:
    class Strict(Says):
        def answered(self, message: bytes) -> bytes:
            return pack({"heard": len(unpack(message))})

    with ZeromqServer(lambda: Strict(lambda _n: b"")) as server:  # type: ignore[arg-type,return-value]
        answer = unpack(asked(server.url, message, 5))
        assert set(answer) <= {"error", "heard"}
        assert unpack(asked(server.url, PING, 5)) == {"heard": 1}


def test_large_messages_are_refused_over_zeromq() -> None:
    with (
        ZeromqServer(lambda: Says(lambda _n: b"yes"), guard=Guard(largest=10_000)) as server,  # type: ignore[arg-type,return-value]
        dealer(server.url) as line,
    ):
        line.send_multipart([b"", b"x" * 10_001])
        assert not line.poll(300)
        assert asked(server.url, b"x" * 10_000, 5) == b"yes"


def test_callers_without_end_have_no_desks_without_end() -> None:
    made: list[Says] = []

    def desk() -> Says:
        made.append(Says(lambda _n: b"yes"))
        return made[-1]

    with ZeromqServer(desk, guard=Guard(callers=3)) as server:  # type: ignore[arg-type]
        for _ in range(8):
            asked(server.url, PING, 5)
        assert len(made) == 8
        assert len(server._desks) == 3


def test_a_loop_that_breaks_ends_the_command_with_two() -> None:
    code = (
        "import sys, simulate.servers.zeromq as z\n"
        "z.ZeromqServer._serve = lambda self: 1 / 0\n"
        "sys.argv = ['safestage', 'serve', 'idle', '--protocol', 'groot', '--port', '0']\n"
        "from safestage_eval.cli import main; main()\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], check=False, capture_output=True, text=True, timeout=60
    )
    assert run.returncode == 2, run
    assert "the server ended: ZeroDivisionError" in run.stderr


@pytest.mark.parametrize(
    "headers",
    [{"Origin": "http://evil.example"}, {"Origin": "null"}, {"Origin": "http://localhost:1"}],
)
def test_web_pages_are_refused(headers: dict[str, str]) -> None:
    with (
        saying(lambda _n: pack({})) as (url, _),
        pytest.raises(InvalidStatus, match="403"),
        connect(url, additional_headers=headers),
    ):
        pass


@pytest.mark.parametrize("path", ["/", "/healthz"])
def test_a_name_that_was_pointed_at_this_machine_is_refused(path: str) -> None:
    with saying(lambda _n: pack({})) as (url, _):
        port = int(url.rsplit(":", 1)[1])
        for host, status in ((f"evil.example:{port}", b"403"), (f"localhost:{port}", b"101 200")):
            with socket.create_connection(("127.0.0.1", port), timeout=10) as line:
                key = base64.b64encode(bytes(16)).decode()
                line.sendall(
                    f"GET {path} HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                    f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
                )
                assert line.recv(20).split()[1] in status.split()


def test_600_mib_are_refused_by_the_first_bytes_that_say_so() -> None:
    """A frame's header states its length: nothing is set aside for it."""
    with saying(lambda _n: pack({})) as (url, _), connect(url) as line:
        line.recv()
        before = resident(os.getpid())
        head = bytes([0x82, 0xFF]) + (600 << 20).to_bytes(8, "big") + bytes(4)
        with suppress(OSError):
            line.socket.sendall(head + bytes(1 << 16))
        with pytest.raises(ConnectionClosedError, match="1009"):
            line.recv(timeout=10)
        assert resident(os.getpid()) - before < 32 << 20
        with connect(url) as other:
            other.recv()


def test_callers_beyond_the_limit_are_told_to_try_later() -> None:
    with (
        WebsocketServer(lambda: Says(lambda _n: b""), guard=Guard(callers=1)) as server,  # type: ignore[arg-type,return-value]
        connect(server.url) as first,
    ):
        first.recv()
        with connect(server.url) as second, pytest.raises(ConnectionClosedError, match="1013"):
            second.recv(timeout=10)


def test_few_bytes_do_not_become_many_objects() -> None:
    for bomb in (
        b"\xdd" + (1 << 30).to_bytes(4, "big") + b"\xc0" * 100,
        b"\xdd" + (MOST_TOGETHER + 1).to_bytes(4, "big") + b"\xc0" * (MOST_TOGETHER + 1),
        (b"\xdd" + (16).to_bytes(4, "big"))
        + (b"\xdd" + MOST_TOGETHER.to_bytes(4, "big") + b"\x80" * MOST_TOGETHER) * 16,
    ):
        with pytest.raises(ValueError, match="MessagePack"):
            unpack(bomb)
    assert len(unpack(pack([1.5] * MOST_TOGETHER))) == MOST_TOGETHER < MOST_VALUES


def test_arrays_hold_what_they_claim() -> None:
    for shape in ([1 << 33], [2]):
        with pytest.raises(ValueError, match="MessagePack"):
            unpack(pack({b"nd": True, b"type": "<f8", b"shape": shape, b"data": bytes(8)}))
    for dtype in ("({", "f8,f8", "O", "V8", "<U99999999"):
        with pytest.raises(ValueError, match="MessagePack"):
            unpack(pack({b"nd": True, b"type": dtype, b"shape": [1], b"data": bytes(8)}))
    square = np.asfortranarray(np.arange(6.0).reshape(2, 3))
    assert np.array_equal(unpack(pack(square, "nd")), square)


def test_sizes_and_names_on_the_command_line_are_checked() -> None:
    with pytest.raises(InputError):
        Guard(("a b",))
