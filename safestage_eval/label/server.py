"""The page's server: this machine alone, one page, and only files that a session hands out."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from safestage_eval._text.json_text import from_json
from safestage_eval.errors import InputError

from .label_page import label_page
from .session import Session

LOOPBACK = "127.0.0.1"
LARGEST_BODY = 65536
SAFETY = {
    "Content-Security-Policy": "frame-ancestors 'none'",  # the page itself says the rest
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Refused(Exception):  # noqa: N818
    """A request that is answered with a status other than 200."""

    def __init__(self, status: HTTPStatus, why: str) -> None:
        super().__init__(why)
        self.status = status


class Server(ThreadingHTTPServer):
    """Serves one session on the loopback interface."""

    daemon_threads = True

    def __init__(self, session: Session, port: int = 0) -> None:
        """Bind to a port; 0 is any that is free. Raises OSError if it is taken."""
        self.session = session
        super().__init__((LOOPBACK, port), _Handler)

    @property
    def url(self) -> str:
        """The page's address."""
        return f"http://{LOOPBACK}:{self.server_port}/"

    @property
    def hosts(self) -> frozenset[str]:
        """Host names that a browser on this machine uses; any other points to DNS rebinding."""
        return frozenset(f"{name}:{self.server_port}" for name in (LOOPBACK, "localhost"))

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore browsers that hang up."""


def serve(session: Session, port: int = 0) -> Server:
    """Bind a server that is not yet running. Raises InputError if the port is taken."""
    try:
        return Server(session, port)
    except OSError as error:
        raise InputError(f"port {port}", f"cannot be had: {error.strerror}.", fix="try another --port") from None  # fmt: skip


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server_version, sys_version = "SafeStage", ""
    timeout = 60
    server: Server

    def do_GET(self) -> None:
        """Send the page, or data that it requests."""
        self._answer(self._get)

    def do_POST(self) -> None:
        """Store an answer of a reviewer."""
        self._answer(self._post)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        """Log nothing: the terminal belongs to the command."""

    def _answer(self, act: Callable[[], None]) -> None:
        try:
            self._check_sender()
            act()
        except Refused as error:
            self._send_json({"error": str(error)}, error.status)
        except InputError as error:
            self._send_json({"error": str(error)}, HTTPStatus.UNPROCESSABLE_ENTITY)
        except (BrokenPipeError, ConnectionResetError):
            self.close_connection = True
        except OSError as error:
            why = f"{self.server.session.ledger.path.name}: {error.strerror or error}"
            self._send_json({"error": f"not saved: {why}"}, HTTPStatus.INTERNAL_SERVER_ERROR)

    def _check_sender(self) -> None:
        """Accept only our own page under our own host name: others could otherwise read and label."""
        hosts = self.server.hosts
        if self.headers.get("Host") not in hosts:
            self.close_connection = True
            raise Refused(HTTPStatus.FORBIDDEN, "this page is for this machine alone")
        origin = self.headers.get("Origin")
        if origin is not None and origin not in {f"http://{host}" for host in hosts}:
            self.close_connection = True
            raise Refused(HTTPStatus.FORBIDDEN, "asked by another page")

    def _get(self) -> None:
        session, url = self.server.session, urlsplit(self.path)
        if url.path == "/":
            self._send(label_page(len(session.refs), session.reviewer).encode(), "text/html; charset=utf-8")  # fmt: skip
        elif url.path == "/state":
            reviewer = parse_qs(url.query).get("reviewer", [""])[0]
            self._send_json(session.state(reviewer))
        elif match := re.fullmatch(r"/rollout/(\d{1,9})(/film|/video)?", url.path):
            number, part = int(match[1]), match[2]
            if number >= len(session.refs):
                raise Refused(HTTPStatus.NOT_FOUND, "no such rollout")
            self._send_rollout(number, part)
        else:
            raise Refused(HTTPStatus.NOT_FOUND, "no such page")

    def _send_rollout(self, number: int, part: str | None) -> None:
        session = self.server.session
        try:
            if part is None:
                self._send_json(session.item(number))
            elif part == "/film":
                more = {"Content-Encoding": "gzip"}
                self._send(session.film(number), "application/octet-stream", more=more)
            else:
                self._send_video(session.video(number))
        except InputError as error:  # its message names the file: for the terminal alone
            print(f"rollout {number + 1} cannot be shown: {error}", file=sys.stderr)  # noqa: T201
            why = f"rollout {number + 1} cannot be shown; the terminal says why"
            raise Refused(HTTPStatus.UNPROCESSABLE_ENTITY, why) from None

    def _post(self) -> None:
        body = self._body()
        if self.path != "/answer":
            raise Refused(HTTPStatus.NOT_FOUND, "no such page")
        number, session = body.get("rollout"), self.server.session
        if type(number) is not int or not 0 <= number < len(session.refs):
            raise Refused(HTTPStatus.NOT_FOUND, "no such rollout")
        reviewer = str(body.get("reviewer", ""))
        session.answer(number, str(body.get("label")), reviewer, str(body.get("note", "")))
        self._send_json(session.state(reviewer))

    def _body(self) -> dict[str, Any]:
        length = self.headers.get("Content-Length", "")
        if not length.isdigit() or int(length) > LARGEST_BODY:
            self.close_connection = True
            raise Refused(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too long")
        data = self.rfile.read(int(length))
        if self.headers.get_content_type() != "application/json":  # what forms cannot send
            raise Refused(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "JSON is expected")
        try:
            body = from_json(data)
        except ValueError:
            body = None
        if not isinstance(body, dict):
            raise Refused(HTTPStatus.BAD_REQUEST, "not a JSON object")
        return body

    def _send_video(self, path: Path | None) -> None:
        """Send a whole film, or the part that the browser asks for (RFC 9110, section 14)."""
        if path is None:
            raise Refused(HTTPStatus.NOT_FOUND, "no video")
        size = path.stat().st_size
        span = re.fullmatch(r"bytes=(\d*)-(\d*)", self.headers.get("Range", ""))
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
        self._send(data, "video/mp4", status, more)

    def _send_json(self, value: Any, status: HTTPStatus = HTTPStatus.OK) -> None:
        self._send(json.dumps(value).encode(), "application/json", status)

    def _send(
        self,
        data: bytes,
        kind: str,
        status: HTTPStatus = HTTPStatus.OK,
        more: dict[str, str] | None = None,
    ) -> None:
        self.send_response(status)
        for name, value in {"Content-Type": kind, **SAFETY, **(more or {})}.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)
