"""GR00T N1.7 as Isaac-GR00T serves it: ZeroMQ request and reply, MessagePack.

Facts: Isaac-GR00T's ``server_client.py`` (endpoints, errors) and ``gr00t_policy.py`` (batches; as many
pictures as ``get_modality_config`` names moments), RoboLab's ``policies/gr00t`` (the keys of the DROID
embodiment behind ``--use-sim-policy-wrapper``, 180 × 320, arrays as msgpack-numpy writes them, 8 of 40
actions played), Isaac-GR00T's ``examples/DROID/main_gr00t.py`` (nested keys without the wrapper; nine numbers
for the flange's pose; the first picture stands for what was before it).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, field_validator
from scipy.spatial.transform import Rotation

from simulate.cameras.lookback import Images
from simulate.policy import Observation

from .dialect import CAMERA, F64, Asked, Dialect, closed, joined, received
from .images import Image, resize_with_pad
from .message_arrays import Style

SIZE = (180, 320)
"""Pixels: height, width."""
TURN = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Right factor of the flange's rotation in the training data."""
PROMPT = "annotation.language.language_instruction"


class Groot(Dialect):
    """GR00T N1.7 with the DROID embodiment."""

    protocol: ClassVar[str] = "groot"
    schemes: ClassVar[tuple[str, ...]] = ("tcp",)
    port: ClassVar[int] = 5555
    arrays: ClassVar[Style] = "nd"
    rows: ClassVar[int] = 40

    horizon: int = Field(8, ge=1)
    keys: Literal["flat", "nested"] = "flat"
    """Flat behind ``--use-sim-policy-wrapper``, nested without it."""
    camera: CAMERA = "exterior_left"
    """The one outside."""
    history: tuple[int, ...] | None = None
    """Control steps before the present of which pictures are sent as well, the farthest first; what
    the server asks for where None. The base model wants (15,), the checkpoint for DROID none."""

    @field_validator("history", mode="before")
    @classmethod
    def _listed(cls, said: Any) -> Any:
        """``15,5``, or 0 for none."""
        if not isinstance(said, str):
            return said
        return tuple(step for step in map(int, said.split(",")) if step > 0)

    @property
    def lookback(self) -> tuple[int, ...]:
        """Earlier pictures to send, stated by the address or by the server."""
        return self.history or ()

    def question(self) -> dict[str, Any] | None:
        """The endpoint ``get_modality_config``, unless the address says what is wanted."""
        return {"endpoint": "get_modality_config"} if self.history is None else None

    def learned(self, answer: Any) -> Self:
        """Moments that the server needs pictures of: ``delta_indices`` of its ``video``."""
        video = answer.get("video", {})
        video = video.get("as_json", video)
        if isinstance(video, str):
            video = json.loads(video)
        moments = [int(step) for step in video.get("delta_indices", [0])]
        if moments != sorted(set(moments)) or moments[-1] != 0:
            raise ValueError(f"pictures of the moments {moments}, which do not end with 0")
        return self.model_copy(update={"history": tuple(-step for step in moments[:-1])})

    def described(self) -> Any:
        """The answer to ``get_modality_config``."""
        moments = [*(-step for step in self.lookback), 0]
        states = ["eef_9d", "gripper_position", "joint_position"]
        modalities = {
            "video": (moments, ["exterior_image_1_left", "wrist_image_left"]),
            "state": ([0], states),
            "action": ([*range(self.rows)], states),
            "language": ([0], [PROMPT]),
        }
        return {
            kind: {
                "__ModalityConfig__": True,
                "as_json": {"delta_indices": steps, "modality_keys": keys},
            }
            for kind, (steps, keys) in modalities.items()
        }

    @property
    def cameras(self) -> tuple[str, ...]:
        """One outside, one at the wrist."""
        return self.camera, "wrist"

    def opening(self, _session: str) -> dict[str, Any]:
        """The endpoint ``reset``."""
        return {"endpoint": "reset", "data": {"options": None}}

    def request(self, observation: Observation, session: str) -> dict[str, Any]:  # noqa: ARG002
        """The endpoint ``get_action`` with a batch of one."""
        moments = [*observation.past, observation.images]
        video = {
            "exterior_image_1_left": _frames(moments, self.camera),
            "wrist_image_left": _frames(moments, "wrist"),
        }
        state = {
            "eef_9d": nine(observation),
            "joint_position": observation.joint_position,
            "gripper_position": closed(observation),
        }
        states = {k: np.asarray(v, np.float32)[None, None] for k, v in state.items()}
        prompt = observation.instruction
        sent: dict[str, Any]
        if self.keys == "nested":
            sent = {"video": video, "state": states, "language": {PROMPT: [[prompt]]}}
        else:
            sent = {f"video.{k}": v for k, v in video.items()}
            sent |= {f"state.{k}": v for k, v in states.items()}
            sent[PROMPT] = [prompt]
        return {"endpoint": "get_action", "data": {"observation": sent, "options": None}}

    def actions(self, answer: Any, observation: Observation) -> F64:  # noqa: ARG002
        """Absolute joint positions and the gripper, the first of the batch."""
        first = answer[0]
        return joined(
            *(
                np.asarray(first.get(f"action.{key}", first.get(key)))[0]
                for key in ("joint_position", "gripper_position")
            )
        )

    def asked(self, request: dict[str, Any]) -> Asked:
        """The observation of a request."""
        sent = request["data"]["observation"]
        if self.keys == "flat":
            prompt = sent[PROMPT][0]
        else:
            prompt = sent["language"][PROMPT][0][0]
            sent = {f"{kind}.{k}": v for kind in ("video", "state") for k, v in sent[kind].items()}
        views = {
            self.camera: np.asarray(sent["video.exterior_image_1_left"])[0],
            "wrist": np.asarray(sent["video.wrist_image_left"])[0],
        }
        moments = 1 + len(self.lookback)
        for view in views.values():
            if view.shape != (moments, *SIZE, 3):
                raise ValueError(f"video of shape {view.shape}, not {(moments, *SIZE, 3)}")
        joints, gripper = sent["state.joint_position"], sent["state.gripper_position"]
        return Asked(received(joints, gripper, prompt, views, moments=True))

    def answer(self, actions: F64, observation: Observation) -> list[Any]:  # noqa: ARG002
        """Actions with a batch of one, and nothing about them."""
        prefix = "action." if self.keys == "flat" else ""
        rows = actions.astype(np.float32)[None]
        return [
            {f"{prefix}joint_position": rows[..., :7], f"{prefix}gripper_position": rows[..., 7:]},
            {},
        ]


def nine(observation: Observation) -> F64:
    """(9,) the flange's position (m) and the first two rows of its turned rotation."""
    w, x, y, z = observation.flange_orientation
    rotation = Rotation.from_quat([x, y, z, w]).as_matrix() @ TURN
    return np.concatenate([observation.flange_position, rotation[:2].reshape(6)])


def _frames(moments: Sequence[Images], camera: str) -> Image:
    """(1, T, H, W, 3), of one camera."""
    return np.stack([resize_with_pad(images[camera], *SIZE) for images in moments])[None]
