"""From a message to its answer, in any of the protocols."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from safestage_eval.errors import InputError
from simulate.clients.arrays import pack, unpack
from simulate.clients.dialect import Dialect
from simulate.policies import Observation

from .episode import Direct, Shadow, at_home, is_own

DONE = "reset successful"
"""What DreamZero's server says to a reset, as a text."""


class Desk:
    """Answers the messages of one client, episode after episode.

    An episode begins with a reset, another session, another prompt, or the arm at home again.
    """

    def __init__(
        self,
        dialect: Dialect,
        policy: str,
        seed: int = 0,
        task: str | None = None,
        tell: Callable[[str], None] = lambda _line: None,
    ) -> None:
        """``tell`` hears of every episode that begins."""
        self._dialect, self._tell = dialect, tell
        self._begin: Callable[[Observation], Direct | Shadow] = (
            partial(Direct, policy) if is_own(policy) else partial(Shadow, policy, seed, task)
        )
        self._episode: Direct | Shadow | None = None
        self._session: str | None = None

    def greeting(self) -> bytes:
        """What a websocket's server says first."""
        return pack(self._dialect.greeting(), self._dialect.style)

    def answered(self, message: bytes) -> bytes | str:
        """The answer. Raises InputError or ValueError for what cannot be answered."""
        request = unpack(message)
        if not isinstance(request, dict):
            raise ValueError("a request is a map")
        endpoint = request.get("endpoint")
        if endpoint == "reset":
            self._episode = None
            return DONE if self._dialect.schemes[0] == "ws" else self._packed({})
        if endpoint == "ping":
            return self._packed({"status": "ok", "message": "Server is running"})
        try:
            asked = self._dialect.asked(request)
        except (KeyError, IndexError, TypeError) as error:
            raise ValueError(f"not a request of {self._dialect.protocol}: {error!r}") from None
        seen = asked.observation
        known = self._episode is not None and asked.session == self._session
        if not known or (
            at_home(seen) and self._episode is not None and not self._episode.fits(seen)
        ):
            self._episode, self._session = self._begin(seen), asked.session
            self._tell(self._episode.about)
        if self._episode is None:
            raise ValueError("no episode")
        rows = max(self._dialect.rows, self._dialect.horizon)
        actions = self._episode.answer(seen, self._dialect.horizon, rows)
        return self._packed(self._dialect.answer(actions, seen))

    def _packed(self, message: Any) -> bytes:
        return pack(message, self._dialect.style)


def complaint(error: Exception) -> str:
    """What a client is told of an error."""
    known = isinstance(error, InputError | ValueError)
    return str(error) if known else f"{type(error).__name__}: {error}"
