"""A served policy: requests actions, checks them, and reports what went wrong."""

from __future__ import annotations

import os
import uuid
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulate.policy import Observation, PolicyError

from .address import Address
from .line import SETTING, Line, LostError, WebsocketLine, ZeromqLine, last_line
from .message_arrays import pack, unpack

F64 = NDArray[np.float64]

TOKEN = "SAFESTAGE_POLICY_TOKEN"  # noqa: S105 - the name of a variable, not a token
"""Environment variable with the token of servers that want one."""


class Remote:
    """A served policy. Every episode has a connection and a session of its own."""

    def __init__(self, address: Address, seed: int | None = None) -> None:
        """Nothing is connected before ``reset``. Only a served reference receives the seed, if any."""
        self.address, self.name, self._seed = address, address.name, seed
        self._dialect = address.dialect
        self.cameras, self.image_size = self._dialect.cameras, self._dialect.image_size
        self._patience = address.common.timeout or self._dialect.patience
        self._line: Line | None = None

    @property
    def lookback(self) -> tuple[int, ...]:
        """Control steps before a request of which it has pictures as well; known after ``reset``."""
        return self._dialect.lookback

    def reset(self, task: str, _prompt: str) -> None:
        """Connect and tell the server that an episode begins. Raises PolicyError."""
        self.close()
        self._task, self._session = task, str(uuid.uuid4())
        self._line = self._connected()
        if self._seed is not None and getattr(self._line, "wants_setting", False):
            setting = {"endpoint": SETTING, "task": task, "seed": self._seed}
            self._asked(self._sealed(setting), max(self.address.common.wait, 1.0))
        try:
            opening = self._dialect.opening(self._session)
            if opening is not None:
                self._asked(self._sealed(opening), max(self.address.common.wait, 1.0), opening=True)
            self._dialect = self.address.dialect
            question = self._dialect.question()
            if question is not None:
                self._learn(question)
        except PolicyError:
            self.close()
            raise

    def _learn(self, question: dict[str, Any]) -> None:
        answer = self._asked(self._sealed(question), max(self.address.common.wait, 1.0))
        try:
            self._dialect = self._dialect.learned(answer)
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            message = f"its answer to {question.get('endpoint')!r} is not understood: {error}."
            raise PolicyError(
                self.address.url, message, fix="say ?history=0, or what it is"
            ) from None

    def act(self, observation: Observation) -> F64:
        """(N, 8) the actions to be played before the next request. Raises PolicyError."""
        message = self._sealed(self._dialect.request(observation, self._session))
        try:
            answer = self._asked(message, self._patience)
        except LostError as lost:
            if self._dialect.remembers:
                raise PolicyError(
                    lost.where, f"{lost.what} What the server remembered of the episode is lost."
                ) from None
            self.close()
            self._line = self._connected()
            answer = self._asked(message, self._patience)
        return self._understood(answer, observation)

    def close(self) -> None:
        """Hang up."""
        if self._line is not None:
            self._line.close()
            self._line = None

    def _connected(self) -> Line:
        url = self.address.url
        if url.startswith("tcp:"):
            return ZeromqLine(url)
        token = os.environ.get(TOKEN, "")
        kind = f"{self._dialect.bearer} {token}" if token else ""
        return WebsocketLine(url, self.address.common.wait, kind)

    def _sealed(self, message: dict[str, Any]) -> bytes:
        token = os.environ.get(TOKEN, "")
        if token and self.address.url.startswith("tcp:"):
            message = {**message, "api_token": token}
        return pack(message, self._dialect.arrays)

    def _asked(self, message: bytes, patience: float, *, opening: bool = False) -> Any:
        if self._line is None:
            raise RuntimeError("reset comes before act")
        result = self._line.ask(message, patience)
        if isinstance(result, str):
            if opening:
                return result
            raise PolicyError(self.address.url, f"the server says: {last_line(result)}")
        try:
            answer = unpack(result)
        except ValueError as error:
            raise PolicyError(self.address.url, f"its answer is {error}.") from None
        if isinstance(answer, dict) and "error" in answer:
            raise PolicyError(
                self.address.url, f"the server says: {last_line(str(answer['error']))}"
            )
        return answer

    def _understood(self, answer: Any, observation: Observation) -> F64:
        url, horizon = self.address.url, self._dialect.horizon
        try:
            actions = self._dialect.actions(answer, observation)
        except (KeyError, IndexError, TypeError, ValueError, AttributeError) as error:
            said = f"no {error}" if isinstance(error, KeyError) else str(error)
            raise PolicyError(
                url, f"its answer is not one of {self._dialect.protocol}'s: {said}.",
                "(N, 8): seven joints and the gripper",
            ) from None  # fmt: skip
        if not np.isfinite(actions).all():
            row = int(np.argmin(np.isfinite(actions).all(axis=1)))
            raise PolicyError(url, f"action {row} of its answer is not finite.")
        if len(actions) < horizon:
            raise PolicyError(
                url, f"it answers {len(actions)} actions, and {horizon} are to be played.",
                fix=f"set ?horizon={len(actions)} or less, if the model is meant to be run so",
            )  # fmt: skip
        return actions[:horizon]
