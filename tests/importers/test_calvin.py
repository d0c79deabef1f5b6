"""CALVIN's frames: blocks as recorded, furniture and arm by their joints."""

import numpy as np
import pytest
from studio import run
from test_place_robot import chain

from safestage_eval.formats import load

TABLE = """<robot name="t"><link name="base_link"><collision><origin xyz="0 0 0.5"/><geometry><box size="1 1 0.1"/></geometry></collision></link>
<link name="drawer_link"><collision><geometry><box size="0.2 0.2 0.1"/></geometry></collision></link>
<joint name="base__drawer" type="prismatic"><parent link="base_link"/><child link="drawer_link"/><origin xyz="0.225 0 0.4"/>
<axis xyz="0 -1 0"/><limit lower="0" upper="0.275"/></joint></robot>"""


def frames(folder, count=40, scene_obs=None):
    folder.mkdir()
    t = np.arange(count) / 30
    for i in range(count):
        obs = np.zeros(24)
        obs[1] = 0.1 * t[i]  # the drawer
        for block in range(3):
            obs[6 + 6 * block : 12 + 6 * block] = [0.2 * block, 0, 0.46, 0, 0, 0.3 * block]
        robot = np.zeros(15)
        robot[6], robot[7:14] = 0.04, 0.05 * np.arange(7) * t[i]
        np.savez(folder / f"episode_{100 + i:07d}.npz", scene_obs=obs if scene_obs is None else scene_obs,
                 robot_obs=robot, actions=np.zeros(7), rgb_static=np.zeros((2, 2, 3), np.uint8))  # fmt: skip
    np.save(folder / "ep_start_end_ids.npy", np.array([[100, 100 + count - 1]]))
    return folder


@pytest.fixture
def source(tmp_path):
    (tmp_path / "data" / "urdf").mkdir(parents=True)
    (tmp_path / "data" / "urdf" / "calvin_table_A.urdf").write_text(TABLE)
    (tmp_path / "map.toml").write_text('[source]\nscene = "A"\n')
    return frames(tmp_path / "validation")


def take(source, *more):
    folder = source.parent
    return run("import", source, "--to", folder / "out", "--map", folder / "map.toml",
               "--assets", folder / "data", *more)  # fmt: skip


def test_blocks_and_furniture(source):
    done = take(source)
    assert done.code == 0, done.err
    assert "looks wrong" not in done.err
    theirs = load(source.parent / "out")
    assert theirs.header.frame_dt == pytest.approx(1 / 30)
    pink, blue = theirs.bodies["block_pink"], theirs.bodies["block_blue"]
    assert pink.geoms[0].size == pytest.approx((0.02, 0.02, 0.02))  # small, first in scene A
    assert blue.geoms[0].size == pytest.approx((0.04, 0.02, 0.02))
    turn = theirs.track("block_blue").orientation[0]
    assert turn == pytest.approx([np.cos(0.15), 0, 0, np.sin(0.15)], abs=1e-6)
    drawer = theirs.track("table_drawer_link").position
    assert drawer[0] == pytest.approx([0.8 * 0.225, 0, 0.8 * 0.4])
    assert drawer[-1, 1] == pytest.approx(-0.1 * 39 / 30, abs=1e-6)
    assert theirs.bodies["table_base_link"].kind == "fixture"
    assert theirs.bodies["table_base_link"].geoms[0].size == pytest.approx((0.4, 0.4, 0.04))
    assert "poses of the links of robot" in done.text


def test_the_arm_by_its_description(source):
    robot = source.parent / "chain.urdf"
    robot.write_text(chain(9))
    done = take(source, "--robot", robot)
    assert done.code == 0, done.err
    theirs = load(source.parent / "out")
    assert theirs.track("robot_base").position[0] == pytest.approx([-0.34, -0.46, 0.24])
    assert theirs.frames.joint_position[-1, 1] == pytest.approx(0.05 * 39 / 30, abs=1e-6)
    assert theirs.bodies["hand_left_finger"].finger == "left"


def test_everything_that_is_missing_is_named_at_once(source):
    done = run("import", source, "--to", source.parent / "out")
    assert done.code == 2
    for what in ("lacks 2 things", "[source] scene", "calvin_table_", "--assets"):
        assert what in done.err


@pytest.mark.parametrize(
    ("key", "array"),
    [("scene_obs", np.zeros(24, complex)), ("robot_obs", np.zeros(15, "U8")), ("actions", np.zeros(6)),
     ("actions", np.zeros((7, 1))), ("scene_obs", np.array(1.0)), ("actions", np.zeros(7, "M8[s]"))],
)  # fmt: skip
def test_a_frame_with_other_arrays_is_refused(source, key, array):
    path = source / "episode_0000120.npz"
    with np.load(path) as frame:
        np.savez(path, **{**frame, key: array})
    done = take(source)
    assert done.code == 2
    assert f"episode_0000120.npz: {key}: {array.shape} {array.dtype}." in done.err
    assert "bug" not in done.err
