"""Nothing is lost between an episode and its files, whichever way it goes."""

import tempfile
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from recordings import falling_cube
from strategies import episodes

from safestage_eval.episode import Body, Header, check
from safestage_eval.errors import TraceError
from safestage_eval.formats import TraceWriter, load, save, validate


def same_arrays(a, b):
    """Equal shapes, types and bits."""
    for column in fields(a):
        one, other = getattr(a, column.name), getattr(b, column.name)
        assert one.dtype == other.dtype, column.name
        assert one.shape == other.shape, column.name
        assert one.tobytes() == other.tobytes(), column.name


def same_episode(a, b):
    assert a.header == b.header
    assert a.t.tobytes() == b.t.tobytes()
    assert list(a.tracks) == list(b.tracks)
    for name in a.tracks:
        same_arrays(a.tracks[name], b.tracks[name])
    same_arrays(a.contacts, b.contacts)
    same_arrays(a.frames, b.frames)
    assert set(a.meshes) == set(b.meshes)
    for key in a.meshes:
        same_arrays(a.meshes[key], b.meshes[key])
    for part in ("channels", "states"):
        one, other = getattr(a, part), getattr(b, part)
        assert set(one) == set(other)
        assert all(one[key].tobytes() == other[key].tobytes() for key in one)
    assert dict(a.attachments) == dict(b.attachments)
    assert a.content_hash == b.content_hash


@given(episodes())
def test_parquet_and_mcap_keep_every_bit(episode):
    assert check(episode) == []
    with tempfile.TemporaryDirectory() as folder:
        dataset, file, second = (Path(folder) / name for name in ("ds", "a.mcap", "ds2"))
        save(episode, dataset)
        from_parquet = load(dataset)
        same_episode(episode, from_parquet)
        save(from_parquet, file)
        from_mcap = load(file)
        same_episode(episode, from_mcap)
        save(from_mcap, second)
        same_episode(episode, load(second))
        for path in (dataset, file, second):
            assert validate(path) == []


@given(episodes())
def test_an_mcap_file_depends_on_the_episode_alone(episode):
    with tempfile.TemporaryDirectory() as folder:
        one, other = (Path(folder) / name for name in ("a.mcap", "b.mcap"))
        save(episode, one)
        save(load(one), other)
        assert one.read_bytes() == other.read_bytes()


def test_times_need_no_nominal_rate(tmp_path):
    t = np.array([-0.5, 0.0, np.nextafter(0.0, 1), 1 / 3, 1e4])
    header = Header(
        episode_id="e",
        physics_dt=0.01,
        frame_dt=float(np.median(np.diff(t))),
        bodies=(Body(name="cup", kind="object"),),
    )
    writer = TraceWriter(header)
    for time in t:
        writer.add_frame(time, np.array([[0, 0, 0, 1, 0, 0, 0]]))
    for target in ("ds", "a.mcap"):
        writer.close(tmp_path / target)
        assert load(tmp_path / target).t.tolist() == t.tolist()


def test_a_dataset_grows_by_whole_episodes(tmp_path):
    for i in range(3):
        falling_cube(f"e{i}").close(tmp_path)
    with pytest.raises(TraceError, match="3 episodes are here"):
        load(tmp_path)
    assert load(tmp_path, "e1").header.episode_id == "e1"
