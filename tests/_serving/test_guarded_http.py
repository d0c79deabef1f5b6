"""Every request over HTTP is answered with a status and a reason, whatever it holds."""

import http.client
import json
import select
import socket
import threading
import time
from contextlib import ExitStack, contextmanager, suppress

import pytest

from safestage_eval._serving.guard import Guard
from safestage_eval._serving.guarded_http import GuardedHandler, GuardedServer


class Echo(GuardedHandler):
    def get(self, url):
        self.send_json({"path": url.path} if url.path != "/bug" else 1 / 0)

    def post(self, url):
        self.send_json(self.body())


@contextmanager
def served(guard=None):
    server = GuardedServer(Echo, guard or Guard(largest=4096))
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def raw(server, request):
    """The status line and the body that answer some bytes."""
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=10) as line:
        line.sendall(request)
        response = http.client.HTTPResponse(line)
        response.begin()
        return response.status, response.read()


def post(server, body, *headers):
    host = f"Host: localhost:{server.server_port}".encode()
    lines = [b"POST / HTTP/1.1", host, b"Content-Type: application/json", *headers]
    return raw(server, b"\r\n".join(lines) + b"\r\n\r\n" + body)


@pytest.mark.parametrize(
    "length",
    ["²".encode("latin-1"), b"-1", b"0x10", b"+1", b"", b"1e3", b"9" * 5000, b"1\r\nContent-Length: 2"],
)  # fmt: skip
def test_a_length_that_is_no_number_is_answered(length):
    with served() as server:
        status, body = post(server, b"{}", b"Content-Length: " + length)
        assert status == 400
        assert json.loads(body)["error"]
        assert post(server, b"{}", b"Content-Length: 2") == (200, b"{}")


@pytest.mark.parametrize(
    "body",
    [
        b'{"a": "\\u0000"}', b'{"a": "\\ud800"}', b'{"\\udfff": 1}', b'{"a": ["\\ud800"]}', b"\xff",
        b"[]", b"{", b"[" * 4000, b'{"a": ' + b"9" * 4000 + b"e",
    ],
)  # fmt: skip
def test_text_that_cannot_be_stored_is_answered(body):
    with served() as server:
        status, answer = post(server, body, b"Content-Length: %d" % len(body))
        assert status == 400
        assert json.loads(answer)["error"]


@pytest.mark.parametrize(("path", "status"), [(b"http://[", 400), (b"/bug", 500), (b"/x", 200)])
def test_every_path_is_answered(path, status):
    with served() as server:
        host = f"Host: localhost:{server.server_port}".encode()
        assert raw(server, b"GET " + path + b" HTTP/1.1\r\n" + host + b"\r\n\r\n")[0] == status


def test_strangers_are_refused():
    with served() as server:
        assert raw(server, b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n")[0] == 403
        assert raw(server, b"GET / HTTP/1.0\r\n\r\n")[0] == 403
        picture = f"GET /x HTTP/1.1\r\nHost: localhost:{server.server_port}\r\nSec-Fetch-Site: cross-site\r\n\r\n"
        assert raw(server, picture.encode())[0] == 403


def get(server):
    return raw(server, f"GET /x HTTP/1.1\r\nHost: localhost:{server.server_port}\r\n\r\n".encode())


@contextmanager
def slow_line(server, begin=b"G"):
    with socket.create_connection(("127.0.0.1", server.server_port), timeout=10) as line:
        line.sendall(begin)
        yield line


def seconds_until_hung_up(line, every):
    """Send a byte now and then until the server hangs up."""
    begun = time.monotonic()
    while time.monotonic() < begun + 5:
        with suppress(ConnectionError):
            if select.select([line], [], [], every)[0]:
                assert line.recv(1) == b"", "the server answered half a request"
                break
            line.sendall(b"x")
    return time.monotonic() - begun


@pytest.mark.parametrize(
    ("begin", "every"),
    [
        (b"", 9),
        (b"", 0.05),
        (b"GET /x HTTP/1.1\r\nX-Long: ", 0.05),
        (b"POST /x HTTP/1.1\r\nHost: localhost:PORT\r\nContent-Length: 4000\r\n\r\n", 0.05),
        (b"GET /x HTTP/1.1\r\nHost: localhost:PORT\r\n\r\n", 0.05),
    ],
    ids=["nothing", "first line", "head", "body", "second request"],
)
def test_head_and_body_of_a_request_come_within_a_deadline_in_all(begin, every, monkeypatch):
    """Each byte used to begin the time anew: a byte a second kept a place for an hour."""
    monkeypatch.setattr(Echo, "patience", 0.6)
    with served() as server:
        begin = begin.replace(b"PORT", b"%d" % server.server_port)
        with slow_line(server, begin) as line:
            if begin.startswith(b"GET") and begin.endswith(b"\n"):
                response = http.client.HTTPResponse(line)
                response.begin()
                response.read()
            assert seconds_until_hung_up(line, every) < 3
        assert get(server)[0] == 200


def test_slow_callers_keep_nobody_out():
    """Two hundred of them held all places for 90 s."""
    with served() as server, ExitStack() as lines:
        for _ in range(200):
            lines.enter_context(slow_line(server))
        begun = time.monotonic()
        for _ in range(5):
            assert get(server)[0] == 200
        assert time.monotonic() - begun < 5


def test_no_more_callers_than_the_guard_allows():
    """The one that was waited for longest loses its place to a newcomer."""
    with served(Guard(callers=2)) as server, slow_line(server) as first:
        time.sleep(0.2)
        with slow_line(server) as second, slow_line(server) as third:
            assert first.recv(1) == b""
            assert select.select([second, third], [], [], 0.3)[0] == []
