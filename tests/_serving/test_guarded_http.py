"""Every request over HTTP is answered with a status and a reason, whatever it holds."""

import http.client
import json
import socket
import threading
from contextlib import contextmanager

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


def test_what_is_too_long_is_refused_before_it_is_read():
    with served() as server:
        assert post(server, b"", b"Content-Length: 4097")[0] == 413
        assert post(server, b"", b"Content-Length: 999999999999")[0] == 413


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


def test_the_name_of_this_machine_is_not_looked_up(monkeypatch):
    """A resolver that does not answer held the page back for as long as it took."""

    def asked(*_):
        raise AssertionError("the network was asked")

    for name in ("getfqdn", "gethostbyaddr", "gethostname", "getaddrinfo"):
        monkeypatch.setattr(socket, name, asked)
    with served() as server:
        assert server.url == f"http://127.0.0.1:{server.server_port}/"


def test_no_more_callers_than_the_guard_allows():
    with served(Guard(callers=1)) as server:
        address = ("127.0.0.1", server.server_port)
        with socket.create_connection(address, 10) as first, socket.create_connection(address, 10) as second:  # fmt: skip
            first.sendall(b"GET /")  # not a whole request: its place stays taken
            assert second.recv(1) == b""
