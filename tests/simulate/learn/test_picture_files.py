"""Pictures drawn from a recording are those that a policy would have seen in it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from safestage_eval.formats import discover
from simulate.learn.picture_files import draw_scene, read_pictures, scenes_of, states
from simulate.learn.picture_recipe import CAMERAS, EVERY, SIZE, stacked
from simulate.looks.room import look_numbers
from simulate.record.jobs import write_recording
from simulate.record.rollout import Setting, roll_out
from simulate.tasks.task import task_named
from simulate.world.world import World

pytestmark = [pytest.mark.simulate, pytest.mark.slow]
SETTING = Setting(task_named("ets_apple_over_domino_row"), seed=3, horizon=0.4)


class Looking:
    """Moves its arm a little, and keeps what it sees and how the world stands."""

    name = "looking"
    cameras = CAMERAS
    image_size = SIZE
    tracks_objects = True

    def reset(self, _task: str, _prompt: str) -> None:
        self.seen: list[np.ndarray] = []
        self.poses: list[dict[str, np.ndarray]] = []

    def act(self, observation) -> np.ndarray:
        self.seen.append(stacked(observation.images))
        self.poses.append(observation.objects)
        return np.tile(np.append(observation.joint_position + 0.02, 1.0), (EVERY, 1))


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("recorded")
    policy = Looking()
    writer = roll_out(SETTING, policy)
    write_recording(writer, SETTING.task, folder)
    return folder, policy, writer.episode()


def test_what_is_drawn_afterwards_is_what_was_seen(recorded, tmp_path: Path) -> None:
    folder, policy, _ = recorded
    (scene,) = scenes_of(discover([folder]))
    assert draw_scene(scene, tmp_path) == ""
    drawn = read_pictures(tmp_path)
    (rows,) = drawn.rows.values()
    pictures = drawn.files[0][rows]
    assert len(pictures) == len(policy.seen) == 2
    moved = np.abs(pictures[0].astype(int) - pictures[1]).mean()
    for one, other in zip(pictures, policy.seen, strict=True):
        assert np.abs(one.astype(int) - other).mean() < 0.05 * moved, "another picture"
    before = drawn.files[0].copy()
    (tmp_path / "ets_apple_over_domino_row.s3.npy").touch()
    assert draw_scene(scene, tmp_path) == "", "what is there is not drawn again"
    assert np.array_equal(read_pictures(tmp_path).files[0], before)


def test_states_put_the_world_where_it_was(recorded) -> None:
    _, policy, episode = recorded
    task = SETTING.task
    world = World(task.models(), substeps=task.substeps, look=look_numbers(task.id, SETTING.seed))
    world.reset(task.layout(SETTING.seed))
    rows = np.array([0, 8 * EVERY])
    for state, poses in zip(states(world, episode, rows), policy.poses, strict=True):
        world.data.qpos[:] = state
        assert world.arm_position == pytest.approx(
            episode.frames.joint_position[rows[0], :7], abs=0.2
        )
        for name, pose in world.object_poses().items():
            assert pose == pytest.approx(poses[name], abs=1e-6)
