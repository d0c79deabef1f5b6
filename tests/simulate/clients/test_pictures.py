"""Pictures in requests are of the moment of the other numbers, and of the moments looked back to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from closed_loop import ByRote

import simulate.record.rollout
from safestage_eval.episode import Episode
from simulate.clients.address import dialect_of
from simulate.policies.policy_names import policy_named
from simulate.policy import Observation
from simulate.record.rollout import Setting, roll_out
from simulate.servers.websocket import WebsocketServer
from simulate.servers.zeromq import ZeromqServer
from simulate.tasks.task import task_named

pytestmark = pytest.mark.simulate

TASK = task_named("fsh_orange_on_plate")


class Clock:
    """Cameras whose pictures show the control step at which they were drawn."""

    def __init__(self, world: Any, names: Sequence[str], size: tuple[int, int]) -> None:
        self._world, self._names, self._size = world, names, size
        self._start = world.data.time

    def images(self) -> dict[str, Any]:
        step = round((self._world.data.time - self._start) * 15)
        return {name: np.full((*self._size, 3), step, np.uint8) for name in self._names}

    def close(self) -> None: ...


class Drifts(ByRote):
    """Turns the first joint on and on, and keeps what it was asked."""

    def __init__(self, protocol: str, asked: list[Any]) -> None:
        super().__init__(dialect_of(protocol))
        self._asked = asked

    def rows(self, seen: Observation) -> np.ndarray:
        self._asked.append(seen)
        rows = super().rows(seen).copy()
        rows[:, 0] += 0.05 * len(self._asked) + 0.005 * np.arange(len(rows))
        return rows


def rolled(
    monkeypatch: pytest.MonkeyPatch, protocol: str, steps: int, serving: str = ""
) -> tuple[list[Any], Episode]:
    """Requests to a server in a rollout, and the episode; ``serving``: options of the server."""
    monkeypatch.setattr(simulate.record.rollout, "Cameras", Clock)
    asked: list[Any] = []
    name, _, options = protocol.partition("?")
    kind = ZeromqServer if name == "groot" else WebsocketServer
    with kind(lambda: Drifts(f"{name}?{serving or options}", asked)) as server:  # type: ignore[arg-type,return-value]
        policy = policy_named(f"{name}:{server.url}?{options}")
        episode = roll_out(Setting(TASK, horizon=steps / 15), policy).episode()
    assert episode.header.termination == "horizon", episode.header.notes
    return asked, episode


def shown(images: Any) -> int:
    """The step that all cameras show: in the middle, where no border is."""
    (found,) = {int(picture[len(picture) // 2, 5, 0]) for picture in images.values()}
    return found


@pytest.mark.parametrize(
    ("protocol", "horizon", "back"),
    [
        ("openpi", 15, []),
        ("groot", 8, []),
        ("groot?history=15", 8, [15]),
        ("groot?history=20,5&horizon=10", 10, [20, 5]),
        ("dreamzero", 24, [23, 16, 8]),
        ("dreamzero?frames=1", 24, []),
        ("cosmos3", 32, []),
    ],
)
def test_pictures_are_of_the_moments_that_they_should_be_of(
    monkeypatch: pytest.MonkeyPatch, protocol: str, horizon: int, back: list[int]
) -> None:
    asked, episode = rolled(monkeypatch, protocol, 66)
    steps = [*range(0, 66, horizon)]
    assert len(asked) == len(steps)
    for step, seen in zip(steps, asked, strict=True):
        assert shown(seen.images) == step
        first = protocol == "dreamzero" and step == 0
        wanted = [] if first else [max(step - b, 0) for b in back]
        assert [shown(images) for images in seen.past] == wanted
        before, after = episode.frames.joint_position[max(8 * step - 1, 0) : 8 * step + 1][
            [0, -1], :7
        ]
        between = before + 0.25 * (
            after - before
        )  # a frame holds the moment of its last physics step
        assert seen.joint_position == pytest.approx(between, abs=1e-3), "of the frames' moment"
    moved = np.ptp([seen.joint_position[0] for seen in asked])
    assert moved > 0.1, "so that a moment could be distinguished from another"
