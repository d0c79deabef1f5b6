"""Recording frame by frame."""

import numpy as np
import pytest
from recordings import STILL, falling_cube, header, pose, table_top

from safestage_eval.episode import Body, Geom, Header, Mesh, check
from safestage_eval.errors import TraceError
from safestage_eval.formats import TraceWriter, load, validate


def test_an_episode_is_what_was_recorded():
    episode = falling_cube().episode()
    assert check(episode) == []
    assert len(episode) == 20
    np.testing.assert_allclose(episode.tracks["cube"].position[:, 2], 1 - 4.905 * episode.t**2)
    assert len(episode.tracks["table"]) == 1
    contacts = episode.contacts
    # said from the cube's side; in the table the fixture comes first, so both vectors turn round
    assert (contacts.frame, contacts.body1, contacts.body2) == (19, 0, 1)
    assert contacts.normal.tolist() == [[0, 0, 1]]
    assert contacts.force.tolist() == [[0, 0, 2]]
    assert contacts.peak_force.tolist() == [2]


def test_names_and_arrays_record_the_same():
    by_array, by_name = falling_cube(), TraceWriter(header())
    for i in range(20):
        t = i * 0.01
        by_name.add_frame(
            t,
            {
                "ball": ((1, 0, 0.5), STILL),
                "cube": ((0, 0, 1 - 4.905 * t * t), STILL),
                "table": ((0, 0, table_top(20) - 0.02), STILL),
            },
            {"cube": ((0, 0, -9.81 * t), (0, 0, 0))},
            contacts={
                "geom1": [1],
                "geom2": [0],
                "position": [(0, 0, table_top(20))],
                "normal": [(0, 0, -1)],
                "force": [(0, 0, -2)],
            }
            if i == 19
            else None,
        )
    assert by_name.episode().content_hash == by_array.episode().content_hash


def test_a_pair_s_peak_force_is_summed_over_its_points():
    writer = falling_cube(frames=1)
    point = {"position": (0, 0, 0), "normal": (0, 0, 1), "force": (1, 0, 2)}
    rows = [{"body1": a, "body2": b} | point for a, b in (("table", "cube"),) * 2]
    rows.append({"body1": "cube", "body2": "ball"} | point)
    writer.add_frame(5.0, pose(0), contacts=rows)
    assert writer.window(1, 2).contacts.peak_force.tolist() == [4, 4, 2]


def test_windows_keep_their_times_and_contacts_and_do_not_change_later():
    writer = falling_cube(frames=20)
    window = writer.window(15, 20)
    height = window.tracks["cube"].position[:, 2].copy()
    for i in range(5000):  # far beyond the first buffers
        writer.add_frame(1 + i, pose(0))
    assert window.t.tolist() == pytest.approx([0.15, 0.16, 0.17, 0.18, 0.19])
    assert window.contacts.frame.tolist() == [4]
    assert (window.tracks["cube"].position[:, 2] == height).all()
    assert len(writer) == 5020
    assert writer.episode().t[-1] == 5000


def test_bodies_joints_and_meshes_can_be_added_one_by_one(tmp_path):
    mesh = Mesh.build([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    empty = Header(episode_id="e", physics_dt=0.01, frame_dt=0.01)
    with TraceWriter(empty, tmp_path / "e.mcap") as writer:
        writer.add_body(Body(name="floor", kind="fixture", movable=False), (0, 0, 0))
        shape = Geom(kind="mesh", mesh=mesh.key)
        writer.add_body(Body(name="flag", kind="object", geoms=(shape,)), meshes=[mesh])
        writer.add_frame(0.0, {"flag": ((0, 0, 1), STILL)}, gripper=0.5)
        writer.update_header(success=True, success_time=0.0)
    episode = load(tmp_path / "e.mcap")
    assert [body.name for body in episode.header.bodies] == ["floor", "flag"]
    assert episode.header.success is True
    assert episode.frames.gripper.tolist() == [[0.5]]
    assert episode.meshes[mesh.key].faces.tolist() == [[0, 1, 2]]


def test_states_channels_and_attachments_are_kept(tmp_path):
    writer = TraceWriter(header(), attachments={"task.toml": b"id = 1"})
    writer.set_fixed("table", (0, 0, 0))
    for i in range(3):
        writer.add_frame(
            i / 100,
            pose(1),
            channels={("cube", "temperature"): 20 + i},
            state=[1 / 3] if i == 1 else None,
        )
    for target in ("ds", "e.mcap"):
        writer.close(tmp_path / target)
        episode = load(tmp_path / target)
        assert episode.channels["cube", "temperature"].tolist() == [20, 21, 22]
        assert {n: s.tolist() for n, s in episode.states.items()} == {1: [1 / 3]}
        assert episode.attachments["task.toml"] == b"id = 1"


@pytest.mark.parametrize("target", ["ds", "e.mcap"])
def test_an_exception_leaves_no_file(tmp_path, target):
    with (
        pytest.raises(RuntimeError, match="simulator"),
        falling_cube(path=tmp_path / target) as writer,
    ):
        assert len(writer) == 20
        raise RuntimeError("the simulator exploded")
    assert list(tmp_path.iterdir()) == []


def bad_time(w):
    w.add_frame(0.19, pose(1))


def nobody(w):
    w.add_frame(1.0, {"cup": ((0, 0, 0), STILL)})


def forgotten(w):
    w.add_frame(1.0, {"cube": ((0, 0, 0), STILL)})


def one_for_all(w):
    w.add_frame(1.0, pose(0)[0])


def moved_table(w):
    w.add_frame(1.0, dict.fromkeys(("cube", "ball", "table"), ((0, 0, 0), STILL)))


def late_body(w):
    w.add_body(Body(name="late", kind="object"))


def new_column(w):
    w.add_frame(1.0, pose(1), gripper=1.0)


def new_channel(w):
    w.add_frame(1.0, pose(1), channels={("cube", "fill"): 1.0})


def contact_with_nobody(w):
    point = {"position": (0, 0, 0), "normal": (0, 0, 1), "force": (0, 0, 1)}
    w.add_frame(1.0, pose(1), contacts=[{"body1": "cube", "body2": "cup"} | point])


def contact_without_force(w):
    w.add_frame(1.0, pose(1), contacts={"geom1": [0], "geom2": [1]})


def strange_field(w):
    w.update_header(sucess=True)


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (bad_time, "time does not increase at frame 20: 0.190000 s, then 0.190000 s"),
        (nobody, "there is no body 'cup'. Allowed: table, cube, ball"),
        (forgotten, "'ball' is missing"),
        (one_for_all, r"poses has shape \(7,\), expected \(2, 7\)"),
        (moved_table, "'table' moved, but it is declared fixed"),
        (late_body, "after the first frame"),
        (new_column, "gripper has shape"),
        (new_channel, "was not there at frame 0"),
        (contact_with_nobody, "names 'cup', which is not a body with geoms. Allowed: table, cube"),
        (contact_without_force, "position, normal, force not given"),
        (strange_field, "no field 'sucess'"),
    ],
)
def test_mistakes_are_named_and_do_no_harm(act, message):
    writer = falling_cube()
    before = writer.episode().content_hash
    with pytest.raises(TraceError, match=message):
        act(writer)
    assert len(writer) == 20
    assert writer.episode().content_hash == before


@pytest.mark.parametrize(
    ("geom", "message"),
    [
        (Geom(kind="box", size=(0.1,)), "a box with 1 sizes"),
        (Geom(kind="sphere", size=(-0.1,)), "'cup', geom 0"),
        (Geom(kind="mesh", mesh="bowl"), "mesh 'bowl', which was not given"),
    ],
)
def test_a_body_that_is_not_sound_is_refused_before_the_rollout(geom, message):
    writer = TraceWriter(header())
    before = writer.header
    with pytest.raises(TraceError, match=message):
        writer.add_body(Body(name="cup", kind="object", geoms=(geom,)))
    assert writer.header == before


def test_a_fixed_body_needs_a_pose():
    writer = TraceWriter(header())
    writer.add_frame(0.0, pose(1))
    with pytest.raises(TraceError, match=r"fixed body 'table' has no pose.*set_fixed"):
        writer.episode()


def test_broken_episodes_are_not_written(tmp_path):
    writer = falling_cube(path=tmp_path / "e.mcap")
    writer.add_frame(np.inf, pose(1.0))
    with pytest.raises(TraceError, match="time is not a finite number at row 20"):
        writer.close()
    assert list(tmp_path.iterdir()) == []


NUMBERS = {
    "gravity": [(0, 0, -9), [0, 0, -9], np.array([0, 0, -9]), np.array([0, 0, -9.8], np.float32)],
    "physics_dt": [1, np.int64(1), np.float32(0.002)],
    "control_dt": [1, np.float32(0.1)],
    "seed": [3.0, np.int64(3)],
    "horizon": [20, np.int32(20), np.float32(1.1)],
    "bodies": [
        tuple(body.model_copy(update={"mass": 2, "com": [0, 0, 0]}) for body in header().bodies),
        tuple(body.model_copy(update={"mass": np.float32(0.1)}) for body in header().bodies),
    ],
}


@pytest.mark.parametrize("name", ["one.mcap", "dataset"])
@pytest.mark.parametrize(("field", "value"), [(f, v) for f, vs in NUMBERS.items() for v in vs])
def test_a_header_of_any_kind_of_numbers_is_read_as_it_was_written(tmp_path, name, field, value):
    """With ``gravity=(0, 0, -9)`` the hash was of integers, which no reader finds."""
    writer = TraceWriter(header().model_copy(update={field: value}))
    writer.set_fixed("table", (0, 0, 0))
    for i in range(3):
        writer.add_frame(i * 0.01, pose(1))
    ref = writer.close(tmp_path / name)
    assert validate(ref.path) == []
    found = load(ref.path)
    assert found.content_hash == writer.episode().content_hash
    assert found.header == writer.header
