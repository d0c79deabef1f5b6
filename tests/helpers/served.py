"""Servers and blind cameras for tests of served policies."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest

import simulate.record.rollout
from simulate.clients.message_arrays import pack
from simulate.policy import Observation
from simulate.servers.websocket import WebsocketServer
from simulate.servers.zeromq import ZeromqServer

HOME = np.array([0.0, -0.2, 0.0, -0.8, 0.0, 0.6, 0.0]) * np.pi


def picture(seed: int, height: int = 360, width: int = 640) -> Any:
    """(height, width, 3) a smooth picture that no other seed has, which is no mirror of itself."""
    y, x = np.mgrid[:height, :width]
    return np.stack(
        [(x // 3 + seed) % 256, (y // 2 + 2 * seed) % 256, (x + y) // 8 % 256], -1
    ).astype(np.uint8)


def seen(**changes: Any) -> Observation:
    """An observation with all cameras."""
    names = ("exterior_left", "exterior_right", "external", "wrist")
    half = np.sqrt(0.5)
    values: dict[str, Any] = {
        "time": 0.0,
        "joint_position": HOME + 0.25,
        "gripper_opening": 0.75,
        "instruction": "Put the orange on the plate.",
        "images": {name: picture(20 * i) for i, name in enumerate(names)},
        "flange_position": np.array([0.4, -0.1, 0.3]),
        "flange_orientation": np.array([0.0, half, half, 0.0]),
    }
    return Observation(**values | changes)


class Says:
    """Answers a client by rote."""

    def __init__(self, answer: Callable[[int], bytes | str]) -> None:
        """``answer``: to the n-th request."""
        self.answer, self.asked = answer, list[bytes]()

    def greeting(self) -> bytes:
        return pack({})

    def answered(self, message: bytes) -> bytes | str:
        self.asked.append(message)
        return self.answer(len(self.asked) - 1)


@contextmanager
def saying(
    answer: Callable[[int], bytes | str],
    kind: type[WebsocketServer | ZeromqServer] = WebsocketServer,
) -> Iterator[tuple[str, Any]]:
    """A server that answers by rote: its address and, for its closing, itself."""
    with kind(lambda: Says(answer)) as server:  # type: ignore[arg-type,return-value]
        yield server.url, server


class Flat:
    """Cameras that see one colour, at no cost."""

    def __init__(self, _world: Any, names: Sequence[str], size: tuple[int, int]) -> None:
        self._names, self._size = names, size

    def images(self) -> dict[str, Any]:
        return {n: np.full((*self._size, 3), 40 * i, np.uint8) for i, n in enumerate(self._names)}

    def close(self) -> None: ...


@pytest.fixture
def blind(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rollouts draw nothing, and load nothing that is only seen."""
    monkeypatch.setattr(simulate.record.rollout, "Cameras", Flat)
