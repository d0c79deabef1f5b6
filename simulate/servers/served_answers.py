"""From a message to its answer, in any of the protocols."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from safestage_eval.errors import InputError
from simulate.clients.batch import join, part, rows
from simulate.clients.dialect import Asked, Dialect
from simulate.clients.line import SETTING
from simulate.clients.message_arrays import pack, unpack
from simulate.policy import Observation

from .served_episode import Direct, Shadow, at_home, is_own

DONE = "reset successful"
"""DreamZero's answer to a reset, as text."""
MOST_ROWS = 256
"""Observations that one request may hold."""
TOGETHER = 8
"""Episodes that one client may have under way where a request holds several observations."""


@dataclass(frozen=True)
class Open:
    """An episode under way."""

    session: str | None
    episode: Direct | Shadow


class Desk:
    """Answers the messages of one client, episode after episode.

    An episode begins with a reset, another session, another prompt, or the arm at home again. Where a
    request holds several observations, each is of the episode that it fits best.
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
        self._is_own, self._policy, self._seed, self._task = is_own(policy), policy, seed, task
        self._open: list[Open] = []
        self._most = TOGETHER if dialect.batches else 1
        self._resets = 0

    def greeting(self) -> bytes:
        """Greeting on a websocket."""
        return pack(self._dialect.greeting(), self._dialect.style)

    def answered(self, message: bytes) -> bytes | str:
        """The answer. Raises InputError or ValueError for what cannot be answered."""
        request = unpack(message)
        if not isinstance(request, dict):
            raise ValueError("a request is a map")
        endpoint = request.get("endpoint")
        if endpoint == "reset":
            self._resets += 1
            return DONE if self._dialect.schemes[0] == "ws" else self._packed({})
        if endpoint == SETTING:
            self._task, self._seed = str(request["task"]), int(request["seed"])
            return self._packed({})
        if endpoint == "ping":
            return self._packed({"status": "ok", "message": "Server is running"})
        if endpoint == "get_modality_config":
            return self._packed(self._dialect.described())
        try:
            requests = [self._dialect.asked(one) for one in self._single(request)]
        except (KeyError, IndexError, TypeError) as error:
            raise ValueError(f"not a request of {self._dialect.protocol}: {error!r}") from None
        busy: list[Open] = []
        for one in requests:
            busy.append(self._episode_of(one, busy))
        length = max(self._dialect.rows, self._dialect.horizon)
        answers = [
            self._dialect.answer(
                episode.episode.answer(one.observation, self._dialect.horizon, length),
                one.observation,
            )
            for one, episode in zip(requests, busy, strict=True)
        ]
        if not self._dialect.batches:
            return self._packed(answers[0])
        return self._packed([join([actions for actions, _ in answers]), answers[0][1]])

    def _single(self, request: dict[str, Any]) -> list[dict[str, Any]]:
        """A request for each observation."""
        if not self._dialect.batches:
            return [request]
        data = request["data"]
        seen = data["observation"]
        if rows(seen) > MOST_ROWS:
            raise ValueError(f"more than {MOST_ROWS} observations in one request")
        return [
            {**request, "data": {**data, "observation": part(seen, i, i + 1)}}
            for i in range(rows(seen))
        ]

    def _begin(self, first: Observation) -> Direct | Shadow:
        if self._is_own:
            return Direct(self._policy, first)
        return Shadow(self._policy, self._seed, self._task, first)

    def _episode_of(self, request: Asked, busy: list[Open]) -> Open:
        """The episode that an observation is of; a new one where it is the first of one."""
        seen = request.observation
        episodes = [one for one in self._open if one.session == request.session and one not in busy]
        begins = self._resets > 0 and (self._is_own or self._most == 1 or at_home(seen))
        if episodes and not begins:
            best = min(episodes, key=lambda one: one.episode.off(seen))
            if best.episode.fits(seen) or not at_home(seen):
                return best
        self._resets = max(self._resets - 1, 0)
        new = Open(request.session, self._begin(seen))
        self._open = [*self._open, new][-self._most :]
        self._tell(new.episode.about)
        return new

    def _packed(self, message: Any) -> bytes:
        return pack(message, self._dialect.style)


def complaint(error: Exception) -> str:
    """Error message for a client."""
    expected = isinstance(error, InputError | ValueError)
    return str(error) if expected else f"{type(error).__name__}: {error}"
