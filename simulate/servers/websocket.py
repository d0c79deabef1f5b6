"""A server on websockets: openpi's, DreamZero's and Cosmos3's."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

from safestage_eval._process.closing import Closing
from simulate.clients.line import SETTING

from .served_answers import Desk, complaint

if TYPE_CHECKING:
    from websockets.http11 import Request, Response
    from websockets.sync.server import ServerConnection

INTERNAL_ERROR = 1011


class WebsocketServer(Closing):
    """Serves in threads from when it is made until it is closed. A context manager."""

    def __init__(
        self,
        desk: Callable[[], Desk],
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        asks_setting: bool = False,
    ) -> None:
        """Begin to serve.

        Args:
            desk: makes what answers one connection.
            host: to listen on.
            port: to listen on; any free one for 0.
            asks_setting: clients are asked which task and seed they roll out.

        Raises OSError.
        """
        from websockets.sync.server import serve

        self._desk = desk
        self._open: set[ServerConnection] = set()
        self._server = serve(
            self._talk, host, port, compression=None, max_size=None, ping_interval=None,
            process_request=_health, process_response=_asking if asks_setting else None,
        )  # fmt: skip
        shown = f"[{host}]" if ":" in host else host
        self.url = f"ws://{shown}:{self._server.socket.getsockname()[1]}"
        self._thread = threading.Thread(target=self._server.serve_forever, daemon=True)
        self._thread.start()

    def _talk(self, connection: ServerConnection) -> None:
        from websockets.exceptions import ConnectionClosed

        self._open.add(connection)
        desk = self._desk()
        try:
            connection.send(desk.greeting())
            for message in connection:
                data = message if isinstance(message, bytes) else message.encode()
                try:
                    answer = desk.answered(data)
                except Exception as error:  # noqa: BLE001 - sent to the client, whatever it is
                    connection.send(complaint(error))
                    connection.close(INTERNAL_ERROR, "what is wrong is said in the frame before")
                    return
                connection.send(answer)
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

    def wait(self) -> None:
        """Serve until somebody closes it."""
        self._thread.join()


def _health(connection: ServerConnection, request: Request) -> Response | None:
    return connection.respond(200, "OK\n") if request.path == "/healthz" else None


def _asking(connection: ServerConnection, request: Request, response: Response) -> None:  # noqa: ARG001
    response.headers[SETTING] = "task, seed"
