"""π0 and π0.5 as openpi serves them: a websocket, MessagePack, one image outside and one at the wrist.

Facts: openpi's ``droid_policy.py`` (keys, eight dimensions), ``websocket_policy_server.py`` (the
server speaks first; a text is an error), ``examples/droid/main.py`` (224 × 224 with padding, gripper
above 0.5 closes, velocities clipped to ±1); DROID's ``robot_ik_solver.py`` (a velocity of 1 is 0.2 rad
per control step of 1/15 s).
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from simulate.policy import Observation

from .dialect import CAMERA, F64, Asked, Dialect, decided, read_state, sent_state
from .images import resize_with_pad

SIDE = 224
"""Pixels of the images' sides."""
STEP = 0.2
"""rad that a joint goes in a control step at a velocity of 1."""


class Openpi(Dialect):
    """openpi's DROID checkpoints."""

    protocol: ClassVar[str] = "openpi"
    rows: ClassVar[int] = 15
    bearer: ClassVar[str] = "Api-Key"

    horizon: int = Field(15, ge=1)
    actions_are: Literal["position", "velocity"] = Field("position", alias="actions")
    """Absolute joint positions, or joint velocities as in the checkpoints ``pi05_droid``."""
    camera: CAMERA = "exterior_left"
    """The one outside."""

    @property
    def cameras(self) -> tuple[str, ...]:
        """One outside, one at the wrist."""
        return self.camera, "wrist"

    def request(self, observation: Observation, session: str) -> dict[str, Any]:  # noqa: ARG002
        """A request in the form of ``examples/droid/main.py``."""
        images = observation.images
        return {
            "observation/exterior_image_1_left": resize_with_pad(images[self.camera], SIDE, SIDE),
            "observation/wrist_image_left": resize_with_pad(images["wrist"], SIDE, SIDE),
            **sent_state(observation),
        }

    def actions(self, answer: Any, observation: Observation) -> F64:
        """Positions as they are; velocities are added up from the measured position on."""
        result = decided(answer["actions"])
        if self.actions_are == "velocity":
            steps = STEP * np.clip(result[:, :7], -1.0, 1.0)
            result[:, :7] = observation.joint_position + np.cumsum(steps, axis=0)
        return result

    def asked(self, request: dict[str, Any]) -> Asked:
        """The observation of a request."""
        views = {
            self.camera: request["observation/exterior_image_1_left"],
            "wrist": request["observation/wrist_image_left"],
        }
        return Asked(read_state(request, views))

    def answer(self, actions: F64, observation: Observation) -> dict[str, Any]:
        """A map with ``actions``."""
        out = np.array(actions)
        if self.actions_are == "velocity":
            before = np.vstack([observation.joint_position, actions[:-1, :7]])
            out[:, :7] = (actions[:, :7] - before) / STEP
        return {"actions": out.astype(np.float32)}
