"""Connections for requests, by websocket or ZeroMQ, with time limits and clear errors."""

from __future__ import annotations

import time
from contextlib import ExitStack
from typing import Any, Protocol

from safestage_eval._serving.guard import LARGEST_MESSAGE
from simulate.policy import PolicyError

PAUSE = 0.25
"""s between two tries to reach a server."""


SETTING = "safestage-setting"
"""Header of a handshake, by which a served reference asks which task and seed a rollout is of; and the
endpoint that it is sent to. Other servers have neither."""


class Line(Protocol):
    """A connection to a policy server, for one episode."""

    greeting: bytes
    """The server's greeting; empty where it sends none."""

    def ask(self, message: bytes, patience: float) -> bytes | str:
        """Send a message and wait for its answer, at most ``patience`` s. Raises PolicyError."""
        ...

    def close(self) -> None:
        """Hang up."""
        ...


class LostError(PolicyError):
    """The connection broke off: another one may do."""


class WebsocketLine:
    """One websocket. Its server speaks first."""

    def __init__(self, url: str, wait: float, token: str = "") -> None:
        """Connect, trying again for ``wait`` s; ``token``: for the handshake, with its kind before it."""
        from websockets.exceptions import InvalidHandshake, InvalidURI
        from websockets.sync.client import connect

        self._url, self._held = url, ExitStack()
        headers = {"Authorization": token} if token else None
        end, why = time.monotonic() + wait, ""
        while True:
            left = max(end - time.monotonic(), 1.0)
            try:
                self._socket = self._held.enter_context(
                    connect(
                        url,
                        compression=None,
                        max_size=LARGEST_MESSAGE,
                        additional_headers=headers,
                        open_timeout=left,
                        close_timeout=1.0,
                        ping_interval=None,  # a server that thinks does not answer pings
                    )
                )
                break
            except InvalidURI as error:
                raise PolicyError(url, f"not the address of a websocket: {error}.") from None
            except InvalidHandshake as error:
                refused = f"it refuses: {error}."
                raise PolicyError(
                    url, refused, fix="is it a policy server, and the token right"
                ) from None
            except (OSError, EOFError) as error:
                why = _cause(error)
            if time.monotonic() + PAUSE > end:
                raise unreachable(url, wait, why)
            time.sleep(PAUSE)
        response = self._socket.response
        self.wants_setting = response is not None and SETTING in response.headers
        try:
            said = self._receive(max(wait, 1.0), "greeting")
        except PolicyError:
            self.close()
            raise
        if isinstance(said, str):
            self.close()
            raise PolicyError(url, f"the server says: {last_line(said)}")
        self.greeting = said

    def ask(self, message: bytes, patience: float) -> bytes | str:
        """Send and receive."""
        from websockets.exceptions import ConnectionClosed

        try:
            self._socket.send(message)
        except (ConnectionClosed, OSError) as error:
            raise LostError(self._url, f"the connection broke off: {error}.") from None
        return self._receive(patience, "answer")

    def _receive(self, patience: float, part: str) -> bytes | str:
        from websockets.exceptions import ConnectionClosed

        try:
            result: bytes | str = self._socket.recv(timeout=patience)
            return result
        except TimeoutError:
            raise too_slow(self._url, patience, part) from None
        except (ConnectionClosed, OSError) as error:
            raise LostError(self._url, f"the connection broke off: {error}.") from None

    def close(self) -> None:
        """Close the socket."""
        self._held.close()


class ZeromqLine:
    """Request and reply over ZeroMQ. Nobody speaks first, so a dead server shows with the first message."""

    greeting = b""

    def __init__(self, url: str) -> None:
        """Connect; that succeeds whether or not there is a server."""
        import zmq

        self._url = url
        self._socket: Any = zmq.Context.instance().socket(zmq.REQ)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.MAXMSGSIZE, LARGEST_MESSAGE)
        try:
            self._socket.connect(url)
        except zmq.ZMQError as error:
            self._socket.close()
            raise PolicyError(
                url, f"not an address of ZeroMQ: {error}.", "tcp://HOST:PORT"
            ) from None

    def ask(self, message: bytes, patience: float) -> bytes | str:
        """Send and receive. After a failure the line is of no more use."""
        import zmq

        try:
            self._socket.send(message)
            if not self._socket.poll(round(1000 * patience)):
                raise too_slow(self._url, patience, "answer")
            return bytes(self._socket.recv())
        except zmq.ZMQError as error:
            raise LostError(self._url, f"the connection broke off: {error}.") from None

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def unreachable(url: str, wait: float, why: str) -> PolicyError:
    """Nobody is there."""
    return PolicyError(
        url,
        f"no policy server answers there ({why}); tried for {wait:g} s.",
        fix="start it, mend the address, or wait longer with ?wait=SECONDS",
    )


def too_slow(url: str, patience: float, part: str) -> PolicyError:
    """Somebody may be there."""
    return PolicyError(
        url,
        f"the server gave no {part} within {patience:g} s.",
        fix="see whether it still works, or wait longer with ?timeout=SECONDS",
    )


def last_line(said: str) -> str:
    """The last line of a server's traceback."""
    lines = [line.strip() for line in said.strip().splitlines() if line.strip()]
    return lines[-1] if lines else "nothing"


def _cause(error: BaseException) -> str:
    return str(error) or type(error).__name__
