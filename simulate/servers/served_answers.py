"""From a message to its answer, in any of the protocols."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from safestage_eval.errors import InputError
from simulate.clients.dialect import Dialect
from simulate.clients.line import SETTING
from simulate.clients.message_arrays import pack, unpack
from simulate.policy import Observation

from .served_episode import Direct, Shadow, is_own

DONE = "reset successful"
"""DreamZero's answer to a reset, as text."""


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
        self._policy, self._seed, self._task = policy, seed, task
        self._session: str | None = None
        self._episode: Direct | Shadow | None = None

    def greeting(self) -> bytes:
        """Greeting on a websocket."""
        return pack(self._dialect.greeting(), self._dialect.arrays)

    def answered(self, message: bytes) -> bytes | str:
        """The answer. Raises InputError or ValueError for what cannot be answered."""
        request = unpack(message)
        if not isinstance(request, dict):
            raise ValueError("a request is a map")
        endpoint = request.get("endpoint")
        if endpoint == "reset":
            self._episode = None
            return DONE if self._dialect.schemes[0] == "ws" else self._packed({})
        if endpoint == SETTING:
            self._task, self._seed = str(request["task"]), int(request["seed"])
            return self._packed({})
        if endpoint == "ping":
            return self._packed({"status": "ok", "message": "Server is running"})
        if endpoint == "get_modality_config":
            return self._packed(self._dialect.described())
        try:
            asked = self._dialect.asked(request)
        except (KeyError, IndexError, TypeError) as error:
            raise ValueError(f"not a request of {self._dialect.protocol}: {error!r}") from None
        seen, horizon = asked.observation, self._dialect.horizon
        episode = self._episode
        if episode is None or asked.session != self._session or episode.is_over(seen):
            episode = self._begun(seen)
        self._episode, self._session = episode, asked.session
        actions = episode.answer(seen, horizon, max(self._dialect.rows, horizon))
        return self._packed(self._dialect.answer(actions, seen))

    def _begun(self, first: Observation) -> Direct | Shadow:
        episode = (
            Direct(self._policy, first)
            if is_own(self._policy)
            else Shadow(self._policy, self._seed, self._task, first)
        )
        self._tell(episode.about)
        return episode

    def _packed(self, message: Any) -> bytes:
        return pack(message, self._dialect.arrays)


def complaint(error: Exception) -> str:
    """Error message for a client."""
    expected = isinstance(error, InputError | ValueError)
    return str(error) if expected else f"{type(error).__name__}: {error}"
