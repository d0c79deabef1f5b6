"""An HTTP server behind a guard, for pages on this machine."""

from __future__ import annotations

import io
import json
import re
import socket
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from socketserver import TCPServer
from time import monotonic
from typing import Any
from urllib.parse import SplitResult, urlsplit

from safestage_eval._text.json_text import from_json
from safestage_eval.errors import InputError

from .guard import Guard

LOOPBACK = "127.0.0.1"
SAFETY = {
    "Content-Security-Policy": "frame-ancestors 'none'",  # the page itself says the rest
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
FILMS = {".mp4": "video/mp4", ".webm": "video/webm"}
_LENGTH = re.compile("[0-9]{1,18}")
ANSWERED = float("inf")
"""Since when we wait for a caller who waits for us."""


class Refused(Exception):  # noqa: N818
    """A request that is answered with a status other than 200."""

    def __init__(self, status: HTTPStatus, why: str) -> None:
        super().__init__(why)
        self.status = status


class GuardedServer(ThreadingHTTPServer):
    """Serves on the loopback interface, a thread for each connection and no more than the guard allows."""

    daemon_threads = True
    request_queue_size = 128

    def __init__(self, handler: type[GuardedHandler], guard: Guard, port: int = 0) -> None:
        """Bind to a port; 0 is any that is free. Raises InputError if it is taken."""
        self.guard = guard
        self._callers: dict[socket.socket, float] = {}
        try:
            super().__init__((LOOPBACK, port), handler)
        except OSError as error:
            raise InputError(
                f"port {port}", f"cannot be had: {error.strerror}.", fix="try another --port"
            ) from None

    def server_bind(self) -> None:
        """Bind, without the look-up of the machine's name by which the standard library goes on."""
        TCPServer.server_bind(self)
        self.server_name, self.server_port = LOOPBACK, self.server_address[1]

    @property
    def url(self) -> str:
        """The page's address."""
        return f"http://{LOOPBACK}:{self.server_port}/"

    def verify_request(self, request: Any, client_address: Any) -> bool:  # noqa: ARG002
        """Whether a caller gets a place. Where all are taken, the one waited for longest loses its own."""
        callers = self._callers.copy()
        if len(callers) >= self.guard.callers:
            slowest = min(callers, key=callers.__getitem__)
            if callers[slowest] == ANSWERED:
                return False
            self._callers.pop(slowest, None)
            with suppress(OSError):  # it has just hung up itself
                slowest.shutdown(socket.SHUT_RDWR)
        self._callers[request] = monotonic()
        return True

    def shutdown_request(self, request: Any) -> None:
        """Hang up."""
        self._callers.pop(request, None)
        super().shutdown_request(request)

    @contextmanager
    def waiting_for(self, caller: socket.socket, since: float) -> Iterator[None]:
        """It is the caller who has to send or take something, since then (s, monotonic)."""
        self._say(caller, since)
        try:
            yield
        finally:
            self._say(caller, ANSWERED)

    def _say(self, caller: socket.socket, since: float) -> None:
        if caller in self._callers:
            self._callers[caller] = since

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002
        """Ignore browsers that hang up; whatever else went wrong ends this connection alone."""
        error = sys.exception()
        if not isinstance(error, ConnectionError | TimeoutError):
            print(f"a request failed: {type(error).__name__}", file=sys.stderr)  # noqa: T201


class _Incoming(io.RawIOBase):
    """What a caller sends. Raises TimeoutError when the time for a request is over."""

    def __init__(self, server: GuardedServer, connection: socket.socket, seconds: float) -> None:
        self._server, self._connection, self._seconds = server, connection, seconds

    def begin_request(self) -> None:
        """From now on the time for the next request runs."""
        self._since = monotonic()

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        left = self._since + self._seconds - monotonic()
        if left <= 0:
            raise TimeoutError
        usual = self._connection.gettimeout()
        self._connection.settimeout(left)
        try:
            with self._server.waiting_for(self._connection, self._since):
                return self._connection.recv_into(buffer)
        finally:
            self._connection.settimeout(usual)


class GuardedHandler(BaseHTTPRequestHandler):
    """Every request is answered: with what ``get`` and ``post`` send, or with a status and a reason.

    Attributes:
        patience: seconds for the head and the body of a request, counted from when the connection is made
            or the answer before was sent.
        timeout: seconds that a caller may take for an answer.
    """

    protocol_version = "HTTP/1.1"
    server_version, sys_version = "SafeStage", ""
    patience = 10.0
    timeout = 60
    server: GuardedServer

    def setup(self) -> None:
        """Read with a deadline."""
        super().setup()
        self.rfile.close()
        self._incoming = _Incoming(self.server, self.connection, self.patience)
        self.rfile = io.BufferedReader(self._incoming)

    def handle_one_request(self) -> None:
        """Answer the next request, or hang up where it does not come in time."""
        self._incoming.begin_request()
        super().handle_one_request()

    def get(self, url: SplitResult) -> None:  # noqa: ARG002
        """Send what a GET asks for. Raises Refused."""
        raise Refused(HTTPStatus.NOT_FOUND, "no such page")

    def post(self, url: SplitResult) -> None:  # noqa: ARG002
        """Take what a POST brings. Raises Refused."""
        self.close_connection = True
        raise Refused(HTTPStatus.NOT_FOUND, "no such page")

    def not_saved(self, error: OSError) -> str:
        """Answer to a failed disk."""
        return str(error.strerror or error)

    def do_GET(self) -> None:
        """Answer a GET."""
        self._answer(self.get)

    def do_POST(self) -> None:
        """Answer a POST."""
        self._answer(self.post)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        """Log nothing: the terminal belongs to the command."""

    def _answer(self, act: Callable[[SplitResult], None]) -> None:
        try:
            self._check_sender()
            act(self._url())
        except Refused as error:
            self.send_json({"error": str(error)}, error.status)
        except InputError as error:
            self.send_json({"error": str(error)}, HTTPStatus.UNPROCESSABLE_ENTITY)
        except (ConnectionError, TimeoutError):
            self.close_connection = True
        except OSError as error:
            why = f"not saved: {self.not_saved(error)}"
            self.send_json({"error": why}, HTTPStatus.INTERNAL_SERVER_ERROR)
        except Exception as error:  # noqa: BLE001 - one request ends nothing
            self.close_connection = True
            why = f"the server failed on this request: {type(error).__name__}"
            self.send_json({"error": why}, HTTPStatus.INTERNAL_SERVER_ERROR)

    def _check_sender(self) -> None:
        """Accept only our own page under our own host name: others could otherwise read and write."""
        address = self.connection.getsockname()
        headers = self.headers
        why = self.server.guard.refusal(
            (address[0], address[1]),
            headers.get_all("Host") or [],
            headers.get_all("Origin") or [],
            headers.get("Sec-Fetch-Site"),
            headers.get("Sec-Fetch-Mode"),
        )
        if why is not None:
            self.close_connection = True
            raise Refused(HTTPStatus.FORBIDDEN, why)

    def _url(self) -> SplitResult:
        try:
            return urlsplit(self.path)
        except ValueError:
            raise Refused(HTTPStatus.BAD_REQUEST, "no address") from None

    def body(self) -> dict[str, Any]:
        """The JSON object that a POST brings, of text that can be stored. Raises Refused."""
        lengths = self.headers.get_all("Content-Length") or []
        if len(lengths) != 1 or not _LENGTH.fullmatch(lengths[0]):
            self.close_connection = True
            raise Refused(HTTPStatus.BAD_REQUEST, "Content-Length is no number")
        if int(lengths[0]) > self.server.guard.largest:
            self.close_connection = True
            raise Refused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too long")
        data = self.rfile.read(int(lengths[0]))
        if self.headers.get_content_type() != "application/json":  # what forms cannot send
            raise Refused(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "JSON is expected")
        try:
            body = from_json(data)
            json.dumps(body, ensure_ascii=False).encode()  # no half of a character
        except ValueError:
            raise Refused(HTTPStatus.BAD_REQUEST, "no JSON of whole characters") from None
        if not isinstance(body, dict):
            raise Refused(HTTPStatus.BAD_REQUEST, "not a JSON object")
        if any("\0" in value for value in body.values() if isinstance(value, str)):
            raise Refused(HTTPStatus.BAD_REQUEST, "text with a NUL in it")
        return body

    def send_film(self, path: Path | None) -> None:
        """Send a whole film, or the part that the browser asks for (RFC 9110, section 14)."""
        if path is None:
            raise Refused(HTTPStatus.NOT_FOUND, "no video")
        size = path.stat().st_size
        span = re.fullmatch(r"bytes=([0-9]{0,18})-([0-9]{0,18})", self.headers.get("Range", ""))
        first, last, status = 0, size - 1, HTTPStatus.OK
        if span and (span[1] or span[2]):
            first = int(span[1]) if span[1] else max(size - int(span[2]), 0)
            last = min(int(span[2]), last) if span[1] and span[2] else last
            status = HTTPStatus.PARTIAL_CONTENT
            if first > last:
                raise Refused(HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE, "no such part")
        with path.open("rb") as file:
            file.seek(first)
            data = file.read(last - first + 1)
        more = {"Accept-Ranges": "bytes"}
        if status is HTTPStatus.PARTIAL_CONTENT:
            more["Content-Range"] = f"bytes {first}-{last}/{size}"
        self.send(data, FILMS.get(path.suffix.lower(), "video/mp4"), status, more)

    def send_json(self, value: Any, status: HTTPStatus = HTTPStatus.OK) -> None:
        """Send a value as JSON."""
        self.send(json.dumps(value).encode(), "application/json", status)

    def send(
        self,
        data: bytes,
        kind: str,
        status: HTTPStatus = HTTPStatus.OK,
        more: dict[str, str] | None = None,
    ) -> None:
        """Send a whole answer, with the headers that keep it where it belongs."""
        self.send_response(status)
        for name, value in {"Content-Type": kind, **SAFETY, **(more or {})}.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(data)))
        with self.server.waiting_for(self.connection, monotonic()):
            self.end_headers()
            self.wfile.write(data)
