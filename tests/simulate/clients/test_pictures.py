"""Pictures in requests are of the moment of the other numbers, and of the moments looked back to."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from closed_loop import ByRote

import simulate.record.rollout
from safestage_eval.episode import Episode
from simulate.clients.address import address_of
from simulate.clients.conversation import messages
from simulate.clients.message_arrays import unpack
from simulate.policies.policy_names import policy_named
from simulate.policy import Observation
from simulate.record.rollout import Setting, roll_out
from simulate.servers.serve import serve
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

    def __init__(self, address: str, asked: list[Any]) -> None:
        super().__init__(address_of(address).dialect)
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
    with kind(lambda: Drifts(f"{name}:talk:x?{serving or options}", asked)) as server:  # type: ignore[arg-type,return-value]
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


def test_groots_server_is_asked_which_moments_it_wants(monkeypatch: pytest.MonkeyPatch) -> None:
    asked, _ = rolled(monkeypatch, "groot", 24, serving="history=15")
    assert [[shown(images) for images in seen.past] for seen in asked] == [[0], [0], [1]]


def test_what_groots_servers_say_of_the_moments() -> None:
    kind = address_of("groot:talk:x").dialect

    def moments(video: Any) -> Any:
        return kind.learned({"video": video}).lookback

    config = {"delta_indices": [-15, 0], "modality_keys": ["wrist_image_left"]}
    assert moments({"__ModalityConfig__": True, "as_json": config}) == (15,)
    assert moments({"__ModalityConfig_class__": True, "as_json": '{"delta_indices": [0]}'}) == ()
    assert moments({"delta_indices": [-30, -15, 0]}) == (30, 15)
    assert kind.learned({}).lookback == ()
    for wrong in ([0, 1], [0, -15], [-1]):
        with pytest.raises(ValueError, match="moments"):
            moments({"delta_indices": wrong})


@pytest.mark.slow
def test_a_loop_with_real_pictures(tmp_path: Path) -> None:
    """Drawn, sent over a socket, and never the same while the arm moves."""
    with serve("reference:safe", "openpi", port=0, task=TASK.id) as server:
        address = f"openpi:{server.url}?timeout=300&keep={tmp_path}"
        writer = roll_out(Setting(TASK), policy_named(address))
    assert writer.header.termination == "success", writer.header.notes
    assert [camera.name for camera in writer.header.cameras] == ["exterior_left", "wrist"]
    (talk,) = tmp_path.glob("*.talk")
    asked = [unpack(what) for who, what in messages(talk) if who == "asked"]
    assert len(asked) >= 8
    names = ("observation/exterior_image_1_left", "observation/wrist_image_left")
    for one, next_one in pairwise(asked):
        joints = "observation/joint_position"
        if np.abs(one[joints] - next_one[joints]).max() > 0.02:
            for name in names:
                assert (one[name] != next_one[name]).any(), "a picture of an earlier moment"
    for name in names:
        picture = asked[0][name]
        assert picture.shape == (224, 224, 3)
        bars = np.concatenate([picture[:49], picture[-49:]])
        assert bars.max() == 0, "16 : 9 in a square"
        assert picture[49:-49].std() > 20, "there is something to be seen"
