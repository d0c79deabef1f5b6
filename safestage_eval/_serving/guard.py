"""Whom a server answers, and how much it takes from them.

Browsers send requests to this machine for any page that is open in them. Two headers say so: ``Host``, the
name by which the page reached the server (a stranger's name that was pointed at this machine: DNS
rebinding), and ``Origin``, the page's own. Programs send no ``Origin``.
"""

from __future__ import annotations

import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TypeVar
from urllib.parse import urlsplit

from safestage_eval.errors import InputError

A = TypeVar("A")

LOOPBACK_NAMES = ("127.0.0.1", "localhost")
LARGEST_MESSAGE = 64 << 20
"""Bytes. Sixteen observations with four pictures of 360 x 640 have 45 MB."""
CALLERS = 64

_HOST = re.compile(r"(\[[0-9A-Fa-f:.]{2,45}\]|[^\s:/@\[\]]{1,253})(?::(\d{1,5}))?", re.ASCII)


@dataclass(frozen=True)
class Guard:
    """Access limits of one server.

    Attributes:
        names: host names besides those of the loopback interface and the address that a caller
            reached, as ``gpu`` (any port) or ``localhost:9000``; pages from them may ask too.
        largest: bytes of a message.
        callers: connections at a time, where the protocol counts them; episodes under way where not.
    """

    names: tuple[str, ...] = ()
    largest: int = LARGEST_MESSAGE
    callers: int = CALLERS
    _free: threading.Semaphore = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Raises InputError for what is no host name."""
        for name in self.names:
            if _parts(name) is None:
                raise InputError(
                    f"host name {name!r}", "is none.", "NAME, or NAME:PORT", "leave out http://"
                )
        object.__setattr__(self, "_free", threading.Semaphore(self.callers))

    def refusal(
        self,
        address: tuple[str, int],
        hosts: list[str],
        origins: list[str] = [],  # noqa: B006 - never written to
        site: str | None = None,
        mode: str | None = None,
    ) -> str | None:
        """Why a request is not answered; None if it is.

        Args:
            address: IP address and port that the caller reached.
            hosts: every ``Host`` header.
            origins: every ``Origin`` header.
            site: ``Sec-Fetch-Site``, which browsers send.
            mode: ``Sec-Fetch-Mode``.
        """
        if len(hosts) != 1 or not self._knows(hosts[0], address):
            name = hosts[0][:80] if hosts else ""
            return f"Host {name!r} is not answered; --allow-host adds a name"
        if len(origins) > 1:
            return "several Origins"
        for origin in origins:
            try:
                url = urlsplit(origin)
            except ValueError:
                return "Origin is no address"
            if url.scheme not in ("http", "https") or not self._knows(url.netloc, address):
                return f"pages from {origin[:80]!r} are not answered; --allow-host adds a name"
        if site in ("cross-site", "same-site") and mode != "navigate" and not origins:
            return "asked by another page"
        return None

    def _knows(self, host: str, address: tuple[str, int]) -> bool:
        parts = _parts(host)
        if parts is None:
            return False
        name, port = parts
        if name in {*LOOPBACK_NAMES, address[0].lower()} and (port or 80) == address[1]:
            return True
        known = {_parts(each) for each in self.names}
        return (name, None) in known or (name, port) in known

    @contextmanager
    def place(self) -> Iterator[bool]:
        """One of the places for callers for as long as the block lasts; False: all are taken."""
        taken = self._free.acquire(blocking=False)
        try:
            yield taken
        finally:
            if taken:
                self._free.release()


def isolated(act: Callable[[], A], complain: Callable[[Exception], A]) -> A:
    """The answer to one message, or the complaint about it: no message ends the loop it came in by."""
    try:
        return act()
    except Exception as error:  # noqa: BLE001 - the caller hears of it, whatever it is
        return complain(error)


def _parts(host: str) -> tuple[str, int | None] | None:
    """Name and port of a ``Host`` header; None for what is none."""
    match = _HOST.fullmatch(host)
    if match is None:
        return None
    name = match[1].strip("[]").lower().removesuffix(".")
    return name, int(match[2]) if match[2] else None
