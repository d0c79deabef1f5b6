"""An object store on this machine, and something between it and us that counts, delays and fails."""

from __future__ import annotations

import http.client
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

BUCKET = "corpus"


class Between(ThreadingHTTPServer):
    """Hands requests on to a store.

    Attributes:
        delay: s that each answer takes longer.
        failing: of a request's number and path whether it is to fail, in one of these ways in turn:
        ways: 503; "half" an answer, whose line breaks; 429 and its Retry-After; "short", an answer that
            says of itself that it has fewer bytes than were asked for.
        requests: (method, path, bytes of the answer) of those that were handed on.
    """

    daemon_threads = True

    def __init__(self, store: tuple[str, int]) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.store = store
        self.delay = 0.0
        self.failing = lambda number, path: False
        self.ways: tuple[int | str, ...] = ("half", 503)
        self.requests: list[tuple[str, str, int]] = []
        self.failed = 0
        self.count = 0
        self.lock = threading.Lock()

    def handle_error(self, request: object, client_address: object) -> None:
        """Who asked may be gone before the answer."""

    @property
    def url(self) -> str:
        """Address of this end."""
        return f"http://127.0.0.1:{self.server_address[1]}"

    def calm(self) -> None:
        """No delay, no failures, nothing counted."""
        self.delay, self.failing = 0.0, lambda number, path: False
        self.ways = ("half", 503)
        self.requests.clear()
        self.failed = self.count = 0


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Between

    def log_message(self, *_: object) -> None:
        pass

    def _answer(self) -> None:
        with self.server.lock:
            self.server.count += 1
            number = self.server.count
        time.sleep(self.server.delay)
        body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
        ways = self.server.ways
        bad = ways[number % len(ways)] if self.server.failing(number, self.path) else None
        if isinstance(bad, int):
            self.server.failed += 1
            self.send_response(bad)
            if bad == 429:
                self.send_header("Retry-After", "1")
            self.send_header("Content-Length", "0")
            self.end_headers()
            return
        onward = http.client.HTTPConnection(*self.server.store, timeout=30)
        onward.request(self.command, self.path, body, dict(self.headers))
        answer = onward.getresponse()
        data = answer.read()
        onward.close()
        self.server.requests.append((self.command, self.path, len(data)))
        if bad == "short" and self.command == "GET" and len(data) > 1:
            self.server.failed += 1
            data = data[: len(data) // 2]
        self.send_response(answer.status)
        for name, value in answer.getheaders():
            if name.lower() not in ("transfer-encoding", "content-length", "connection"):
                self.send_header(name, value)
        length = answer.getheader("Content-Length") if self.command == "HEAD" else len(data)
        self.send_header("Content-Length", str(length or 0))
        self.end_headers()
        if bad == "half":  # the line breaks in the middle
            self.server.failed += 1
            self.wfile.write(data[: len(data) // 2])
            self.close_connection = True
            return
        self.wfile.write(data)

    do_GET = do_HEAD = do_PUT = do_POST = do_DELETE = _answer  # noqa: N815


@contextmanager
def object_store() -> Iterator[Between]:
    """A store with a bucket, and what stands before it."""
    from moto.server import ThreadedMotoServer

    moto = ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    moto.start()
    host, port = moto.get_host_and_port()
    between = Between((host, port))
    thread = threading.Thread(target=between.serve_forever, daemon=True)
    thread.start()
    try:
        yield between
    finally:
        between.shutdown()
        between.server_close()
        thread.join()
        moto.stop()


def upload(folder: Path, between: Between, name: str) -> str:
    """All files of a folder; the URI that they are under then."""
    import boto3
    from botocore.config import Config

    host, port = between.store
    client = boto3.client(
        "s3",
        endpoint_url=f"http://{host}:{port}",
        region_name="us-east-1",
        aws_access_key_id="test",
        aws_secret_access_key="test",
        config=Config(s3={"addressing_style": "path"}),
    )
    client.create_bucket(Bucket=BUCKET)
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            client.put_object(
                Bucket=BUCKET,
                Key=f"{name}/{path.relative_to(folder).as_posix()}",
                Body=path.read_bytes(),
            )
    client.close()
    return f"s3://{BUCKET}/{name}"
