"""A server on websockets: openpi's, DreamZero's and Cosmos3's."""

from __future__ import annotations

import socket
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from typing import TYPE_CHECKING

from safestage_eval._serving.guard import Guard, isolated
from safestage_eval._serving.listener import Listener
from simulate.clients.line import SETTING

from .served_answers import Desk, complaint

if TYPE_CHECKING:
    from websockets.http11 import Request, Response
    from websockets.sync.server import ServerConnection

INTERNAL_ERROR, TRY_LATER = 1011, 1013
"""Codes of RFC 6455 by which a connection is closed."""


class WebsocketServer(Listener):
    """A thread for each connection, a desk for each caller."""

    def __init__(
        self,
        desk: Callable[[], Desk],
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        asks_setting: bool = False,
        guard: Guard | None = None,
    ) -> None:
        """Begin to serve.

        Args:
            desk: makes what answers one connection.
            host: to listen on.
            port: to listen on; any free one for 0.
            asks_setting: clients are asked which task and seed they roll out.
            guard: whom it answers, and how much it takes.

        Raises OSError.
        """
        from websockets.sync.server import serve

        self._desk, self._guard = desk, guard or Guard()
        self._open: set[ServerConnection] = set()
        self._server = serve(
            self._answer, host, port, compression=None, ping_interval=None,
            max_size=self._guard.largest, max_queue=1,  # frames that wait, each as large as that
            process_request=self._admit, process_response=_asking if asks_setting else None,
        )  # fmt: skip
        shown = f"[{host}]" if ":" in host else host
        self.url = f"ws://{shown}:{self._server.socket.getsockname()[1]}"
        self._begin(self._server.serve_forever)

    def _admit(self, connection: ServerConnection, request: Request) -> Response | None:
        """Refuse whoever is a stranger; answer whoever asks whether the server is well."""
        address = connection.socket.getsockname()
        why = self._guard.refusal(
            (address[0], address[1]),
            request.headers.get_all("Host"),
            request.headers.get_all("Origin"),
        )
        if why is not None:
            return connection.respond(HTTPStatus.FORBIDDEN, why + "\n")
        return connection.respond(HTTPStatus.OK, "OK\n") if request.path == "/healthz" else None

    def _answer(self, connection: ServerConnection) -> None:
        with self._guard.place() as free:
            if free:
                self._talk(connection)
            else:
                connection.close(TRY_LATER, f"{self._guard.callers} callers at a time")

    def _talk(self, connection: ServerConnection) -> None:
        from websockets.exceptions import ConnectionClosed

        self._open.add(connection)
        desk = self._desk()
        trouble: list[Exception] = []

        def complain(error: Exception) -> str:
            trouble.append(error)
            return complaint(error)

        try:
            connection.send(desk.greeting())
            for message in connection:
                connection.send(isolated(lambda m=message: desk.answered(_bytes(m)), complain))  # type: ignore[misc]
                if trouble:
                    connection.close(INTERNAL_ERROR, "what is wrong is said in the frame before")
                    return
        except (ConnectionClosed, OSError):
            return
        finally:
            self._open.discard(connection)

    def close(self) -> None:
        """Break off all connections, as when a server is killed."""
        for connection in list(self._open):
            with suppress(OSError):  # closed meanwhile
                connection.socket.shutdown(socket.SHUT_RDWR)
        self._server.shutdown()
        self._thread.join()


def _bytes(message: bytes | str) -> bytes:
    return message if isinstance(message, bytes) else message.encode()


def _asking(connection: ServerConnection, request: Request, response: Response) -> None:  # noqa: ARG001
    response.headers[SETTING] = "task, seed"
