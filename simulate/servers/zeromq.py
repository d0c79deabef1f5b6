"""A server on ZeroMQ: GR00T's. Unlike the published one it tells its clients apart."""

from __future__ import annotations

import threading
from abc import abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Any

from safestage_eval._serving.guard import Guard, isolated
from safestage_eval._serving.listener import Listener
from simulate.clients.message_arrays import pack

from .served_answers import Desk, complaint

TICK = 50
"""ms between two looks at whether to go on."""
PATIENCE = 2.0
"""s that closing waits for an answer that is under way."""
AT_ONCE = 256
"""Messages that are looked at together."""
WAITING = 2
"""Messages of one caller that may wait: each is as large as the guard lets it be."""

Asked = tuple[bytes, bytes]
"""A client's identity, and its message."""


class Router(Listener):
    """Answers many clients, one batch of messages after the other.

    A message has three parts: who asks, an empty one, the request. Callers of ZeroMQ's REQ kind send
    them so; whatever else comes is answered with an error, or dropped.
    """

    def __init__(
        self, host: str = "127.0.0.1", port: int = 0, guard: Guard | None = None
    ) -> None:  # fmt: skip
        """Port 0 is any free one. Raises OSError."""
        import zmq

        self._guard = guard or Guard()

        self._context = zmq.Context()
        self._socket: Any = self._context.socket(zmq.ROUTER)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.MAXMSGSIZE, self._guard.largest)
        self._socket.setsockopt(zmq.RCVHWM, WAITING)
        try:
            self._socket.bind(f"tcp://{host}:{port or '*'}")
        except zmq.ZMQError as error:
            self._context.destroy()
            raise OSError(str(error)) from None
        self.url = self._socket.getsockopt_string(zmq.LAST_ENDPOINT)
        self._stop = threading.Event()
        self._begin(self._serve)

    @abstractmethod
    def answers(self, waiting: Sequence[Asked]) -> Iterator[Asked]:
        """Answers to all that wait, in any order."""

    def finish(self) -> None:
        """Called in the serving thread when it ends."""

    def _serve(self) -> None:
        try:
            while not self._stop.is_set():
                self._answer(self._received())
        finally:
            self.finish()
            self._context.destroy()

    def _received(self) -> list[Asked]:
        import zmq

        waiting: list[Asked] = []
        while len(waiting) < AT_ONCE and self._socket.poll(0 if waiting else TICK):
            client, *parts = self._socket.recv_multipart(zmq.NOBLOCK)
            if len(parts) == 2 and not parts[0]:
                waiting.append((client, parts[1]))
            else:
                why = f"a message of {len(parts)} parts; a request is an empty part and one more"
                self._send(client, pack({"error": why}), envelope=not (parts and parts[0]))
        return waiting

    def _answer(self, waiting: Sequence[Asked]) -> None:
        """Answer all that wait; where that fails, each by itself, so that one is nobody else's trouble."""
        left = [client for client, _ in waiting]

        def all_of_them() -> None:
            for client, answer in self.answers(waiting):
                left.remove(client)
                self._send(client, answer)

        def one_by_one(error: Exception) -> None:
            if len(waiting) == 1:
                self._send(waiting[0][0], pack({"error": complaint(error)}))
                return
            for client, message in waiting:
                if client in left:
                    left.remove(client)
                    self._answer([(client, message)])

        isolated(all_of_them, one_by_one)

    def _send(self, client: bytes, answer: bytes, *, envelope: bool = True) -> None:
        import zmq

        with suppress(zmq.ZMQError):  # it has gone meanwhile
            self._socket.send_multipart([client, *[b""] * envelope, answer], zmq.NOBLOCK)

    def close(self) -> None:
        """Stop answering."""
        self._stop.set()
        self._thread.join(PATIENCE)


class ZeromqServer(Router):
    """A desk for each client, and as many of them as the guard allows: who asked longest ago begins anew."""

    def __init__(
        self,
        desk: Callable[[], Desk],
        host: str = "127.0.0.1",
        port: int = 0,
        guard: Guard | None = None,
    ) -> None:
        """``desk`` makes what answers one client; port 0 is any free one. Raises OSError."""
        self._desk, self._desks = desk, OrderedDict[bytes, Desk]()
        super().__init__(host, port, guard)

    def answers(self, waiting: Sequence[Asked]) -> Iterator[Asked]:
        """One after the other."""
        for client, message in waiting:
            answer = isolated(
                lambda c=client, m=message: self._desk_of(c).answered(m),  # type: ignore[misc]
                lambda error: pack({"error": complaint(error)}),
            )
            yield client, answer if isinstance(answer, bytes) else answer.encode()

    def _desk_of(self, client: bytes) -> Desk:
        if client not in self._desks:
            self._desks[client] = self._desk()
        self._desks.move_to_end(client)
        while len(self._desks) > self._guard.callers:
            self._desks.popitem(last=False)
        return self._desks[client]
