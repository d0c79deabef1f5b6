"""DreamZero as its repository serves it: a websocket with sessions, three cameras.

Facts: dreamzero's ``eval_utils/policy_server.py`` and ``policy_client.py`` (endpoints, keys, a text after a
reset), ``socket_test_optimized_AR.py`` (180 × 320, two cameras outside; the server gathers the
frames of a session itself), RoboLab's ``policies/dreamzero`` (24 actions played).
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from simulate.policies import Observation

from .dialect import CAMERA, F64, Asked, Dialect, closed, decided, vector
from .images import resize_with_pad

SIZE = (180, 320)
"""Pixels: height, width."""


class Dreamzero(Dialect):
    """DreamZero's DROID checkpoint."""

    protocol: ClassVar[str] = "dreamzero"
    rows: ClassVar[int] = 24
    patience: ClassVar[float] = 600.0
    remembers: ClassVar[bool] = True

    horizon: int = Field(24, ge=1)
    camera: CAMERA = "exterior_left"
    """The first one outside."""
    second: Literal["exterior_left", "exterior_right", "external", "black"] = "exterior_right"
    """The second one outside; black as where it was left out in training."""

    @property
    def cameras(self) -> tuple[str, ...]:
        """Two outside, one at the wrist."""
        both = (
            (self.camera,) if self.second in ("black", self.camera) else (self.camera, self.second)
        )
        return *both, "wrist"

    def opening(self, _session: str) -> dict[str, Any]:
        """The endpoint ``reset``."""
        return {"endpoint": "reset", "session_ids": None}

    def request(self, observation: Observation, session: str) -> dict[str, Any]:
        """The endpoint ``infer``, one frame of each camera."""
        images = {name: resize_with_pad(observation.images[name], *SIZE) for name in self.cameras}
        images["black"] = np.zeros((*SIZE, 3), np.uint8)
        return {
            "observation/exterior_image_0_left": images[self.camera],
            "observation/exterior_image_1_left": images[self.second],
            "observation/wrist_image_left": images["wrist"],
            "observation/joint_position": observation.joint_position.astype(np.float32),
            "observation/cartesian_position": cartesian(observation).astype(np.float32),
            "observation/gripper_position": closed(observation),
            "prompt": observation.instruction,
            "session_id": session,
            "endpoint": "infer",
        }

    def actions(self, answer: Any, observation: Observation) -> F64:  # noqa: ARG002
        """An array, or a map with ``actions``."""
        return decided(answer["actions"] if isinstance(answer, dict) else answer)

    def asked(self, request: dict[str, Any]) -> Asked:
        """The observation and the session of a request."""
        return Asked(
            Observation(
                time=float("nan"),
                joint_position=vector(request["observation/joint_position"], 7),
                gripper_opening=1.0 - float(vector(request["observation/gripper_position"], 1)[0]),
                instruction=str(request["prompt"]),
                images={
                    self.camera: request["observation/exterior_image_0_left"],
                    self.second: request["observation/exterior_image_1_left"],
                    "wrist": request["observation/wrist_image_left"],
                },
            ),
            session=str(request["session_id"]),
        )

    def answer(self, actions: F64, observation: Observation) -> Any:  # noqa: ARG002
        """The bare array."""
        return actions.astype(np.float32)

    def greeting(self) -> dict[str, Any]:
        """What the server wants to be sent."""
        return {
            "image_resolution": SIZE,
            "needs_wrist_camera": True,
            "n_external_cameras": 2,
            "needs_stereo_camera": False,
            "needs_session_id": True,
            "action_space": "joint_position",
        }


def cartesian(observation: Observation) -> F64:
    """(6,) the flange's position (m) and its angles about the fixed x, y and z axes (rad)."""
    w, x, y, z = observation.flange_orientation
    return np.concatenate(
        [observation.flange_position, Rotation.from_quat([x, y, z, w]).as_euler("xyz")]
    )
