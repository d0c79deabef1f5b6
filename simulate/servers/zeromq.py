"""A server on ZeroMQ: GR00T's. Unlike the published one it tells its clients apart."""

from __future__ import annotations

import threading
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

from simulate.clients.arrays import pack

from .answers import Desk, complaint

TICK = 50
"""ms between two looks at whether to go on."""


class ZeromqServer:
    """Serves in a thread from when it is made until it is closed. A context manager."""

    def __init__(self, desk: Callable[[], Desk], host: str = "127.0.0.1", port: int = 0) -> None:
        """``desk`` makes what answers one client; port 0 is any free one. Raises OSError."""
        import zmq

        self._desk, self._desks = desk, dict[bytes, Desk]()
        self._context = zmq.Context()
        self._socket: Any = self._context.socket(zmq.ROUTER)
        self._socket.setsockopt(zmq.LINGER, 0)
        try:
            self._socket.bind(f"tcp://{host}:{port or '*'}")
        except zmq.ZMQError as error:
            self._context.destroy()
            raise OSError(str(error)) from None
        self.url = self._socket.getsockopt_string(zmq.LAST_ENDPOINT)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        while not self._stop.is_set():
            if not self._socket.poll(TICK):
                continue
            client, empty, message = self._socket.recv_multipart()
            desk = self._desks.setdefault(client, self._desk())
            try:
                answer = desk.answered(message)
            except Exception as error:  # noqa: BLE001 - whatever it is, the client is told
                answer = pack({"error": complaint(error)})
            self._socket.send_multipart([client, empty, answer])
        self._context.destroy()

    def close(self) -> None:
        """Stop answering."""
        self._stop.set()
        self._thread.join()

    def wait(self) -> None:
        """Serve until somebody closes it."""
        self._thread.join()

    def __enter__(self) -> Self:
        """The server itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close."""
        self.close()
