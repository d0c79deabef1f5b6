"""Cameras: where they say they are, of the present moment, and filmed beside the trace."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from own_policies import Still

from safestage_eval.episode import Camera
from safestage_eval.formats import load
from simulate.arm import droid
from simulate.cameras.camera_video import NAMES
from simulate.cameras.droid_cameras import SIZE, Cameras, camera_facts
from simulate.policies.policy_names import policy_named
from simulate.record.rollout import Setting, roll_out
from simulate.tasks.task import task_named
from simulate.world.world import World

pytestmark = [pytest.mark.simulate, pytest.mark.slow]

TASK = task_named("fsh_orange_on_plate")


@pytest.fixture(scope="module")
def world() -> World:
    world = World(TASK.models(), substeps=TASK.substeps)
    world.reset(TASK.layout(0))
    return world


def rotation(quaternion: Any) -> Any:
    out = np.empty(9)
    mujoco.mju_quat2Mat(out, np.asarray(quaternion, float))
    return out.reshape(3, 3)


def projected(world: World, facts: Camera, point: Any) -> tuple[float, float]:
    """Row and column of a world point, from what the trace says of a camera."""
    turn, at = np.eye(3), np.zeros(3)
    if facts.body is not None:
        body = world.data.body(facts.body.replace("robot_", droid.PREFIX, 1))
        turn, at = body.xmat.reshape(3, 3), body.xpos
    x, y, z = (turn @ rotation(facts.orientation)).T @ (point - at - turn @ facts.position)
    return facts.cy + facts.fy * y / z, facts.cx - facts.fx * x / z


def test_a_thing_is_where_intrinsics_and_extrinsics_say(world: World) -> None:
    """The orange's middle is orange in both outer views, the plate's is pale in the wrist's."""
    mujoco.mj_forward(world.model, world.data)
    cameras = Cameras(world, NAMES, SIZE)
    images = cameras.images()
    cameras.close()
    facts = {camera.name: camera for camera in camera_facts(world, NAMES, SIZE)}
    assert [facts[name].body is None for name in NAMES] == [True, True, False]
    orange = world.data.body("orange").xpos
    for name in ("exterior_left", "exterior_right"):
        row, column = projected(world, facts[name], orange)
        red, green, blue = images[name][round(row), round(column)].astype(int)
        assert red > green + 40 > blue + 60, (name, red, green, blue)
    row, column = projected(world, facts["wrist"], world.data.body("plate").xpos)
    assert images["wrist"][round(row), round(column)].min() > 165


def test_pictures_are_of_now_and_not_of_a_step_ago(world: World) -> None:
    world.reset(TASK.layout(0))
    ahead = np.append(droid.HOME, 0.0)
    ahead[0] += 0.5
    for _ in range(4):
        world.act(ahead)
    before = world.data.xpos.copy()
    cameras = Cameras(world, ("wrist",), (90, 160))
    moving = cameras.images()["wrist"]
    assert np.array_equal(world.data.xpos, before), "drawing moves nothing"
    mujoco.mj_forward(world.model, world.data)
    assert not np.array_equal(world.data.xpos, before), "poses were a step old"
    assert np.array_equal(cameras.images()["wrist"], moving)
    cameras.close()


def test_a_film_has_a_picture_for_every_eighth_frame(tmp_path: Path) -> None:
    av = pytest.importorskip("av")
    path = tmp_path / "videos" / "one.mp4"
    writer = roll_out(Setting(TASK, horizon=0.4), Still(), path)
    about = writer.header.video
    assert writer.header.cameras == (), "the policy was blind"
    assert about is not None
    assert about.file == "videos/one.mp4"
    assert [camera.name for camera in about.cameras] == [*NAMES]
    assert sum(camera.width for camera in about.cameras) == 3 * SIZE[1]
    with av.open(str(path)) as film:
        pictures = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert len(pictures) * about.frames_per_picture == len(writer) == 48
    assert {picture.shape for picture in pictures} == {(SIZE[0], 3 * SIZE[1], 3)}
    assert [p.name for p in path.parent.iterdir()] == ["one.mp4"]


def test_a_trace_says_what_its_policy_saw(tmp_path: Path) -> None:
    policy = policy_named("own_policies:Seeing")
    writer = roll_out(Setting(TASK, horizon=0.1), policy)
    writer.close(tmp_path)
    header = load(tmp_path).header
    assert [(c.name, c.width, c.height) for c in header.cameras] == [
        ("external", 64, 48),
        ("wrist", 64, 48),
    ]
    assert header.cameras[1].body in {body.name for body in header.bodies}
    assert header.video is None
