"""Cosmos3 Nano Policy as cosmos-framework serves it: openpi's websocket, one image of three views.

Facts: cosmos-framework's ``action_policy_server_robolab.py`` (keys, 32 × 8 actions under ``action``,
540 × 640; it turns the gripper's sense itself, so both directions count 1 as closed), RoboLab's
``policies/cosmos3`` (the three views at 360 × 640, the outer two halved, 32 actions played).
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from simulate.policy import Observation

from .dialect import F64, Asked, Dialect, decided, read_state, sent_state
from .images import composite, resize_with_pad

SIZE = (360, 640)
"""Pixels of the wrist's view: height, width."""


class Cosmos3(Dialect):
    """Cosmos3's DROID checkpoint."""

    protocol: ClassVar[str] = "cosmos3"
    rows: ClassVar[int] = 32
    patience: ClassVar[float] = 300.0

    horizon: int = Field(32, ge=1)

    @property
    def cameras(self) -> tuple[str, ...]:
        """Two outside, one at the wrist."""
        return "exterior_left", "exterior_right", "wrist"

    def request(self, observation: Observation, session: str) -> dict[str, Any]:
        """A request in the form of RoboLab's client."""
        left, right, wrist = (
            resize_with_pad(observation.images[name], *SIZE) for name in self.cameras
        )
        return {
            "observation/image": composite(wrist, left, right),
            **sent_state(observation),
            "session_id": session,
        }

    def actions(self, answer: Any, observation: Observation) -> F64:  # noqa: ARG002
        """Under ``action``, or ``actions`` from other servers of the same model."""
        if answer.get("type") == "error":
            raise ValueError(f"the server says: {answer.get('message')}")
        return decided(answer["action"] if "action" in answer else answer["actions"])

    def asked(self, request: dict[str, Any]) -> Asked:
        """The observation and the session of a request."""
        image = np.asarray(request["observation/image"])
        high, wide = image.shape[0] * 2 // 3, image.shape[1] // 2
        views = {
            "wrist": image[:high],
            "exterior_left": image[high:, :wide],
            "exterior_right": image[high:, wide:],
        }
        session = request.get("session_id")
        return Asked(read_state(request, views), None if session is None else str(session))

    def answer(self, actions: F64, observation: Observation) -> dict[str, Any]:  # noqa: ARG002
        """A map with ``action``."""
        return {"action": actions.astype(np.float32)}
