"""A server on ZeroMQ: GR00T's. Unlike the published one it tells its clients apart."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
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
WAITING = 2
"""Messages of one caller that may wait: each is as large as the guard lets it be."""


class ZeromqServer(Listener):
    """A desk for each client, and as many of them as the guard allows: who asked longest ago begins anew.

    A message has three parts: who asks, an empty one, the request. Callers of ZeroMQ's REQ kind send
    them so; whatever else comes is answered with an error, or dropped.
    """

    def __init__(
        self,
        desk: Callable[[], Desk],
        host: str = "127.0.0.1",
        port: int = 0,
        guard: Guard | None = None,
    ) -> None:
        """``desk`` makes what answers one client; port 0 is any free one. Raises OSError."""
        import zmq

        self._desk, self._desks = desk, OrderedDict[bytes, Desk]()
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

    def _serve(self) -> None:
        try:
            while not self._stop.is_set():
                if self._socket.poll(TICK):
                    self._answer()
        finally:
            self._context.destroy()

    def _answer(self) -> None:
        import zmq

        client, *parts = self._socket.recv_multipart(zmq.NOBLOCK)
        if len(parts) == 2 and not parts[0]:
            answer = isolated(
                lambda: self._desk_of(client).answered(parts[1]),
                lambda error: pack({"error": complaint(error)}),
            )
            self._send(client, answer if isinstance(answer, bytes) else answer.encode())
        else:
            why = f"a message of {len(parts)} parts; a request is an empty part and one more"
            self._send(client, pack({"error": why}), envelope=not (parts and parts[0]))

    def _send(self, client: bytes, answer: bytes, *, envelope: bool = True) -> None:
        import zmq

        with suppress(zmq.ZMQError):  # it has gone meanwhile
            self._socket.send_multipart([client, *[b""] * envelope, answer], zmq.NOBLOCK)

    def close(self) -> None:
        """Stop answering."""
        self._stop.set()
        self._thread.join(PATIENCE)

    def _desk_of(self, client: bytes) -> Desk:
        if client not in self._desks:
            self._desks[client] = self._desk()
        self._desks.move_to_end(client)
        while len(self._desks) > self._guard.callers:
            self._desks.popitem(last=False)
        return self._desks[client]
