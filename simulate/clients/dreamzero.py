"""DreamZero as its repository serves it: a websocket with sessions, three cameras.

Facts: dreamzero's ``eval_utils/policy_server.py`` and ``policy_client.py`` (endpoints, keys, a text after a
reset), ``socket_test_optimized_AR.py`` (180 × 320, two cameras outside; one picture at first, then four to
each answer, gathered by the server where fewer are sent), ``test_client_AR.py`` (which four), RoboLab's
``policies/dreamzero`` (24 actions played, one picture each; the sessions to be forgotten named in a reset).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field, field_validator
from scipy.spatial.transform import Rotation

from simulate.cameras.lookback import Images
from simulate.policy import Observation

from .dialect import CAMERA, F64, Asked, Dialect, decided, read_state, sent_state
from .images import Image, resize_with_pad

SIZE = (180, 320)
"""Pixels: height, width."""
BACK = (23, 16, 8)
"""Control steps before a request of which it has pictures as well, from the second request on."""


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

    frames: Literal[1, 4] = 4
    """Pictures of each camera in a request: four as DreamZero's own client, one as RoboLab's."""

    @field_validator("frames", mode="before")
    @classmethod
    def _number(cls, said: Any) -> Any:
        """A number, of a text in an address."""
        return int(said) if isinstance(said, str) and said.isdigit() else said

    @property
    def lookback(self) -> tuple[int, ...]:
        """Between two requests, so that each answer is of all that was seen since the last."""
        return BACK if self.frames == 4 else ()

    @property
    def cameras(self) -> tuple[str, ...]:
        """Two outside, one at the wrist."""
        both = (
            (self.camera,) if self.second in ("black", self.camera) else (self.camera, self.second)
        )
        return *both, "wrist"

    def opening(self, session: str) -> dict[str, Any]:
        """The endpoint ``reset``, of this session alone: others may be under way."""
        return {"endpoint": "reset", "session_ids": [session]}

    def request(self, observation: Observation, session: str) -> dict[str, Any]:
        """The endpoint ``infer``: one picture of each camera at first, later as many as there are."""
        moments = [*observation.past, observation.images] if observation.time > 0 else []
        moments = moments or [observation.images]
        images = {name: _frames(moments, name) for name in self.cameras}
        images["black"] = np.zeros_like(images["wrist"])
        return {
            "observation/exterior_image_0_left": images[self.camera],
            "observation/exterior_image_1_left": images[self.second],
            "observation/wrist_image_left": images["wrist"],
            **sent_state(observation),
            "observation/cartesian_position": cartesian(observation).astype(np.float32),
            "session_id": session,
            "endpoint": "infer",
        }

    def actions(self, answer: Any, observation: Observation) -> F64:  # noqa: ARG002
        """An array, or a map with ``actions``."""
        return decided(answer["actions"] if isinstance(answer, dict) else answer)

    def asked(self, request: dict[str, Any]) -> Asked:
        """The observation and the session of a request."""
        views = {
            self.camera: np.asarray(request["observation/exterior_image_0_left"]),
            self.second: np.asarray(request["observation/exterior_image_1_left"]),
            "wrist": np.asarray(request["observation/wrist_image_left"]),
        }
        views = {name: view if view.ndim == 4 else view[None] for name, view in views.items()}
        for view in views.values():
            if view.shape not in {(n, *SIZE, 3) for n in (1, 4)}:
                raise ValueError(
                    f"pictures of shape {view.shape}, not (4, {SIZE[0]}, {SIZE[1]}, 3)"
                )
        return Asked(read_state(request, views, moments=True), str(request["session_id"]))

    def answer(self, actions: F64, observation: Observation) -> Any:  # noqa: ARG002
        """The bare array."""
        return actions.astype(np.float32)

    def greeting(self) -> dict[str, Any]:
        """Settings that the server asks for."""
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


def _frames(moments: Sequence[Images], camera: str) -> Image:
    """(H, W, 3) of one moment, (T, H, W, 3) of several."""
    pictures = [resize_with_pad(images[camera], *SIZE) for images in moments]
    return pictures[0] if len(pictures) == 1 else np.stack(pictures)
