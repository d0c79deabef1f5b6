"""MCAP files: for other readers, from other writers, cut off and damaged."""

import json

import numpy as np
import pytest
from foreign_mcap import HEADER, foreign
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from hypothesis import given
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_protobuf.decoder import DecoderFactory
from recordings import falling_cube
from strategies import episodes

from safestage_eval.episode import Body, Geom, Header, Mesh
from safestage_eval.errors import TraceError
from safestage_eval.formats import TraceWriter, discover, load, validate
from safestage_eval.formats.mcap import mcap_records
from safestage_eval.formats.mcap.mcap_messages import EPOCH_NS


@pytest.fixture
def file(tmp_path):
    """A minute of recording: several chunks."""
    path = tmp_path / "cube.mcap"
    falling_cube(frames=6000).close(path)
    return path


def messages(path, topic):
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return [m for *_, m in reader.iter_decoded_messages(topics=[topic])]


def test_the_stock_reader_finds_every_channel(file):
    with file.open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "safestage"
        summary = reader.get_summary()
        topics = {channel.topic: channel for channel in summary.channels.values()}
        assert set(topics) == {
            "/safestage/frame",
            "/safestage/contacts",
            "/tf",
            "/scene",
            "/events",
        }
        counts = summary.statistics.channel_message_counts
        assert counts[topics["/safestage/frame"].id] == 6000
        assert counts[topics["/tf"].id] == 2000  # 30 Hz of 100 Hz, rounded down to every third
        assert summary.statistics.message_start_time == EPOCH_NS
        assert {index.compression for index in summary.chunk_indexes} == {"lz4"}
        [metadata] = reader.iter_metadata()
        assert json.loads(metadata.metadata["header"])["episode_id"] == "cube"


def test_transforms_and_shapes_are_those_of_the_episode(file):
    episode = load(file)
    third = messages(file, "/tf")[1]
    assert {t.child_frame_id for t in third.transforms} == {"table", "cube", "ball"}
    cube = next(t for t in third.transforms if t.child_frame_id == "cube")
    position = episode.tracks["cube"].position[3]
    assert [cube.translation.x, cube.translation.y, cube.translation.z] == position.tolist()
    assert (cube.rotation.w, cube.rotation.x) == (1, 0)
    assert cube.timestamp.ToNanoseconds() == EPOCH_NS + 30_000_000
    [scene] = messages(file, "/scene")
    table = scene.entities[0]
    assert (table.id, table.frame_id, table.frame_locked) == ("table", "table", True)
    assert (table.cubes[0].size.x, table.cubes[0].size.z) == (1, 0.04)
    assert scene.entities[2].spheres[0].size.x == 0.04
    logs = [log.message for log in messages(file, "/events")]
    assert logs == ["start: cube", "end: unknown"]


def test_frames_and_contacts_decode_with_their_schemas(file):
    episode = load(file)
    last = messages(file, "/safestage/frame")[-1]
    assert (last.frame_index, last.time) == (5999, episode.t[-1])
    assert last.body_position[:3] == episode.tracks["cube"].position[-1].tolist()
    first = messages(file, "/safestage/frame")[0]
    assert first.HasField("frame_index")
    assert first.HasField("time")
    cloud = messages(file, "/safestage/contacts")[-1]
    layout = [(f.name, f.offset, f.type) for f in cloud.fields]
    assert layout[:2] == [
        ("x", 0, PackedElementField.FLOAT32),
        ("y", 4, PackedElementField.FLOAT32),
    ]
    assert layout[-1] == ("geom2", 46, PackedElementField.UINT16)
    assert np.frombuffer(cloud.data, "<f4")[6:9].tolist() == [0, 0, 2]


@given(episodes(max_frames=3))
def test_viewers_get_a_message_for_every_kind_of_shape(episode):
    from safestage_eval.formats.mcap.foxglove_scene import to_scene
    from safestage_eval.formats.mcap.mcap_writer import transform_messages

    scene = SceneUpdate.FromString(to_scene(episode, 1).SerializeToString())
    for body, entity in zip(episode.header.bodies, scene.entities, strict=True):
        shapes = len(entity.cubes) + len(entity.spheres) + len(entity.cylinders)
        shapes += len(entity.triangles)
        balls = 2 * sum(geom.kind == "capsule" for geom in body.geoms)
        assert shapes == len(body.geoms) + balls
    for n, data in transform_messages(episode, list(range(len(episode))), 1):
        sent = FrameTransforms.FromString(data).transforms
        for body, transform in zip(episode.header.bodies, sent, strict=True):
            track = episode.track(body.name)
            q = transform.rotation
            assert [q.w, q.x, q.y, q.z] == track.orientation[n].tolist()
            assert transform.translation.z == track.position[n, 2]


# ---------------------------------------------------------------------- cut off and damaged


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8, 0.97])
def test_a_file_cut_off_says_where_and_how_many_frames_are_whole(file, share):
    whole = load(file)
    data = file.read_bytes()
    cut = int(len(data) * share)
    file.write_bytes(data[:cut])
    with pytest.raises(TraceError, match=rf"ends at byte {cut}, .* (\d+) whole frames") as caught:
        load(file)
    frames = int(caught.value.what.split()[-3])
    assert (frames < 6000) == (share < 0.97)
    if frames:
        kept = load(file, recover=True)
        assert len(kept) == frames
        assert kept.t.tolist() == whole.t[:frames].tolist()
        assert kept.header.termination == "truncated"
        assert f"cut off at byte {cut}" in kept.header.notes[-1]
        cube = kept.tracks["cube"].position
        assert (cube == whole.tracks["cube"].position[:frames]).all()
    else:
        with pytest.raises(TraceError, match="0 whole frames"):
            load(file, recover=True)


def test_without_its_last_byte_all_frames_can_be_recovered(file):
    data = file.read_bytes()
    file.write_bytes(data[:-1])
    assert len(load(file, recover=True)) == 6000


def test_changed_bytes_do_not_go_unnoticed(file):
    data = bytearray(file.read_bytes())
    data[len(data) // 2] ^= 1
    file.write_bytes(data)
    with pytest.raises(TraceError, match=r"byte \d+: a damaged record"):
        load(file)


@pytest.mark.parametrize("content", [b"", b"\x89MCAP0\r\n", b"garbage" * 100])
def test_what_is_no_mcap_is_said_to_be_none(tmp_path, content):
    path = tmp_path / "e.mcap"
    path.write_bytes(content)
    with pytest.raises(TraceError, match=r"not an MCAP file|is empty|ends at byte 8"):
        load(path)


def test_an_mcap_of_something_else_is_named(tmp_path):
    path = tmp_path / "ros.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="ros2")
        channel = writer.register_channel("/odom", "cdr", 0)
        writer.add_message(channel, 0, b"", 0)
        writer.finish()
    with pytest.raises(TraceError, match=r"profile 'ros2'.*no trace"):
        load(path)


# ---------------------------------------------------------------------- other writers


@pytest.mark.parametrize(
    ("compression", "chunks"),
    [
        (CompressionType.ZSTD, True),
        (CompressionType.LZ4, True),
        (CompressionType.NONE, True),
        (CompressionType.NONE, False),
    ],
)
def test_files_of_other_writers_are_understood(tmp_path, compression, chunks):
    path = tmp_path / "foreign.mcap"
    foreign(path, compression=compression, chunks=chunks)
    assert validate(path) == []
    episode = load(path)
    assert episode.contacts.frame.tolist() == [1, 3]
    assert episode.contacts.force.tolist() == [[0, 0, -3]] * 2
    assert episode.tracks["table"].position.tolist() == [[0, 0, pytest.approx(-0.1)]]
    assert episode.dt == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("frame", "metadata", "message"),
    [
        (lambda n: {"time": 0.1}, {}, "time does not increase at frame 1"),
        (lambda n: {"frame_index": 7}, {}, "not the frames 0, 1, 2"),
        (lambda n: {"body_orientation": [0, 0, 0, 0.5]}, {}, "orientation of 'cup' at frame 0 has"),
        (lambda n: {"body_position": [0] * 6}, {}, "body_position has 6 values for 1 moving"),
        (lambda n: {"channel": [1]}, {}, "1 channels in a frame, 0 in the header"),
        (None, {"schema_version": "2.0"}, "trace format 2.0 cannot be read"),
        (None, {"header": "{"}, "metadata header: Invalid JSON"),
        (None, {"header": "{}"}, "metadata header.episode_id: Field required"),
        (None, {"frames": "9"}, "4 frames, but the header says 9"),
        (None, {"fixed": "{}"}, "'table' is neither in `moving` nor in `fixed`"),
        (
            None,
            {
                "header": json.dumps(HEADER).replace(
                    '"sphere", "size": [0.03]', '"mesh", "mesh": "ab"'
                )
            },
            "the mesh ab… is missing",
        ),
        (
            None,
            {
                "header": json.dumps(HEADER).replace(
                    '"geoms": [{"kind": "box"', '"x": [{"kind": "box"'
                )
            },
            "geom2 is 1; there are 1 geoms",
        ),
    ],
)
def test_broken_values_never_pass_as_data(tmp_path, frame, metadata, message):
    path = tmp_path / "foreign.mcap"
    foreign(path, frame=frame, **metadata)
    with pytest.raises(TraceError, match=message):
        assert load(path).contacts
    assert message in " ".join(map(str, validate(path))).replace("\\", "")


def test_a_changed_mesh_is_noticed(tmp_path):
    mesh = Mesh.build([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    flag = Body(name="flag", kind="object", geoms=(Geom(kind="mesh", mesh=mesh.key),))
    header = Header(episode_id="e", physics_dt=0.01, frame_dt=0.01, bodies=(flag,))
    writer = TraceWriter(header, meshes=[mesh])
    writer.add_frame(0, {"flag": ((0, 0, 0), (1, 0, 0, 0))})
    writer.close(tmp_path)
    [asset] = (tmp_path / "assets").iterdir()
    data = asset.read_bytes()
    for changed, message in (
        (data[:-1], "the mesh is cut off"),
        (data[:-5] + b"\2" + data[-4:], "the mesh has changed"),
        (b"ply\nformat ascii 1.0\n", "not a mesh of this format"),
    ):
        asset.write_bytes(changed)
        with pytest.raises(TraceError, match=message):
            load(tmp_path).meshes[mesh.key]
    asset.unlink()
    with pytest.raises(TraceError, match=r"the mesh [0-9a-f]{12}… is missing"):
        load(tmp_path)


def test_discovery_reads_the_header_only(file, monkeypatch):
    monkeypatch.setattr(mcap_records, "unpack", None)
    [ref] = discover(file)
    assert ref.fields["length"] == 6000
    assert ref.content_hash
