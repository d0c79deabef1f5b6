"""A server on ZeroMQ: GR00T's. Unlike the published one it tells its clients apart."""

from __future__ import annotations

import threading
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from safestage_eval._process.closing import Closing
from simulate.clients.message_arrays import pack

from .served_answers import Desk, complaint

TICK = 50
"""ms between two looks at whether to go on."""
PATIENCE = 2.0
"""s that closing waits for an answer that is under way."""

Asked = tuple[bytes, bytes]
"""A client's identity, and its message."""


class Router(Closing):
    """Answers many clients in a thread from when it is made until it is closed. A context manager."""

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        """Port 0 is any free one. Raises OSError."""
        import zmq

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

    @abstractmethod
    def answers(self, waiting: Sequence[Asked]) -> Iterator[Asked]:
        """Answers to all that wait, in any order."""

    def finish(self) -> None:
        """Called in the serving thread when it ends."""

    def _serve(self) -> None:
        import zmq

        while not self._stop.is_set():
            waiting: list[Asked] = []
            while self._socket.poll(0 if waiting else TICK):
                client, _empty, message = self._socket.recv_multipart(zmq.NOBLOCK)
                waiting.append((client, message))
            for client, answer in self.answers(waiting):
                self._socket.send_multipart([client, b"", answer])
        self.finish()
        self._context.destroy()

    def close(self) -> None:
        """Stop answering."""
        self._stop.set()
        self._thread.join(PATIENCE)

    def wait(self) -> None:
        """Serve until somebody closes it."""
        self._thread.join()


class ZeromqServer(Router):
    """A desk for each client."""

    def __init__(self, desk: Callable[[], Desk], host: str = "127.0.0.1", port: int = 0) -> None:
        """``desk`` makes what answers one client; port 0 is any free one. Raises OSError."""
        self._desk, self._desks = desk, dict[bytes, Desk]()
        super().__init__(host, port)

    def answers(self, waiting: Sequence[Asked]) -> Iterator[Asked]:
        """One after the other."""
        for client, message in waiting:
            desk = self._desks.setdefault(client, self._desk())
            try:
                answer = desk.answered(message)
            except Exception as error:  # noqa: BLE001 - sent to the client, whatever it is
                answer = pack({"error": complaint(error)})
            yield client, answer if isinstance(answer, bytes) else answer.encode()
