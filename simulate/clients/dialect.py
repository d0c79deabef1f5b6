"""Interface of a protocol: both ends of its conversation, and the meaning of its actions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from simulate.cameras.lookback import Images
from simulate.policy import Observation

from .message_arrays import Style

F64 = NDArray[np.float64]

CAMERA = Literal["exterior_left", "exterior_right", "external"]

THRESHOLD = 0.5
"""Gripper commands above it close, as in all four protocols (0 open, 1 closed)."""


@dataclass(frozen=True)
class Asked:
    """A request as a server reads it."""

    observation: Observation
    session: str | None = None


class Dialect(BaseModel, ABC):
    """A protocol's messages; its fields are what an address may set."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    protocol: ClassVar[str]
    schemes: ClassVar[tuple[str, ...]] = ("ws", "wss")
    port: ClassVar[int] = 8000
    arrays: ClassVar[Style] = "openpi"
    image_size: ClassVar[tuple[int, int]] = (360, 640)
    """(height, width) at which the cameras are drawn, before a model's own size."""
    patience: ClassVar[float] = 60.0
    """s for an answer, unless the address says otherwise."""
    rows: ClassVar[int]
    """Actions that the published model answers with."""
    remembers: ClassVar[bool] = False
    """Whether the server keeps what it saw, so that a broken connection ends the rollout."""
    bearer: ClassVar[str] = "Bearer"
    """Kind of authorisation in the handshake, where a token is given."""

    horizon: int = Field(ge=1)
    """Actions that are played of each answer before the next request."""

    @property
    @abstractmethod
    def cameras(self) -> tuple[str, ...]:
        """The cameras that a request has images of."""

    @property
    def lookback(self) -> tuple[int, ...]:
        """Control steps before a request of which it has pictures as well."""
        return ()

    @abstractmethod
    def request(self, observation: Observation, session: str) -> dict[str, Any]:
        """The request at a control step."""

    @abstractmethod
    def actions(self, answer: Any, observation: Observation) -> F64:
        """(N, 8) joint positions (rad) and gripper (1 closes) from an answer.

        Raises KeyError, TypeError or ValueError for an answer that is none.
        """

    def opening(self, _session: str) -> dict[str, Any] | None:
        """Message that an episode begins; None where the protocol has none."""
        return None

    def question(self) -> dict[str, Any] | None:
        """Question to the server before the first request; None where all is known."""
        return None

    def learned(self, _answer: Any) -> Self:
        """The dialect after the server's answer. Raises as ``actions`` does."""
        return self

    # The other end, for servers of references and for tests.

    @abstractmethod
    def asked(self, request: dict[str, Any]) -> Asked:
        """Read a request. Raises KeyError, TypeError or ValueError for a malformed one."""

    @abstractmethod
    def answer(self, actions: F64, observation: Observation) -> Any:
        """(N, 8) actions as the server says them."""

    def described(self) -> Any:
        """The answer to ``question``."""
        return {}

    def greeting(self) -> dict[str, Any]:
        """A server's greeting on a websocket."""
        return {}


def joined(joints: Any, gripper: Any) -> F64:
    """(N, 8) from (N, 7) and (N,) or (N, 1), the gripper decided. Raises ValueError otherwise."""
    first, last = np.asarray(joints, np.float64), np.asarray(gripper, np.float64)
    if first.ndim != 2 or first.shape[1] != 7 or last.size != len(first):
        raise ValueError(f"actions of shapes {first.shape} and {last.shape}, not (N, 7) and (N, 1)")
    return decided(np.column_stack([first, last.reshape(-1)]))


def decided(actions: Any) -> F64:
    """(N, 8) with the gripper at 0 or 1, from (N, 8). NaN stays. Raises ValueError otherwise."""
    out = np.array(actions, np.float64)
    if out.ndim != 2 or out.shape[1] != 8:
        raise ValueError(f"actions of shape {out.shape}, not (N, 8)")
    grip = out[:, 7]
    out[:, 7] = np.where(np.isnan(grip), grip, grip > THRESHOLD)
    return out


def sent_state(observation: Observation) -> dict[str, Any]:
    """Joints, gripper and prompt under openpi's keys."""
    return {
        "observation/joint_position": observation.joint_position.astype(np.float32),
        "observation/gripper_position": closed(observation),
        "prompt": observation.instruction,
    }


def received(
    joints: Any, gripper: Any, prompt: Any, views: Images, *, moments: bool = False
) -> Observation:
    """An observation as a server reads it: seven joints (rad), how far the gripper is closed, images.

    With ``moments`` each view is (T, H, W, 3), the last picture the present one.

    Raises ValueError for another number of joints.
    """
    past: tuple[Images, ...] = ()
    if moments:
        many = len(views["wrist"])
        past = tuple({name: view[i] for name, view in views.items()} for i in range(many - 1))
        views = {name: view[-1] for name, view in views.items()}
    return Observation(
        time=float("nan"),
        joint_position=vector(joints, 7),
        gripper_opening=1.0 - float(vector(gripper, 1)[0]),
        instruction=str(prompt),
        images=dict(views),
        past=past,
    )


def read_state(request: dict[str, Any], views: Images, *, moments: bool = False) -> Observation:
    """Like ``received``, from openpi's keys."""
    joints, gripper = (request[f"observation/{key}_position"] for key in ("joint", "gripper"))
    return received(joints, gripper, request["prompt"], views, moments=moments)


def vector(thing: Any, length: int) -> F64:
    """(length,) of what has so many numbers, in whatever shape. Raises ValueError otherwise."""
    result = np.asarray(thing, np.float64).reshape(-1)
    if len(result) != length:
        raise ValueError(f"{len(result)} numbers where {length} belong")
    return result


def closed(observation: Observation) -> NDArray[np.float32]:
    """(1,) how far the gripper is closed, as DROID counts: 0 open … 1 closed."""
    return np.array([1.0 - observation.gripper_opening], np.float32)
