"""The recorder's ZIP files read as any other trace, and what is damaged in them is refused."""

import io
import json
import zipfile
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from recordings import falling_cube
from strategies import episodes
from test_round_trip import same_episode
from zipped import written

from safestage_eval.errors import TraceError
from safestage_eval.formats import CONTACT_POINT, discover, load, save, validate


def as_recorded(episode):
    """Without what the recorder does not write; fixed bodies stand still."""
    still = np.zeros((1, 3), np.float32)
    tracks = {
        name: track if episode.bodies[name].movable
        else replace(track, linear_velocity=still, angular_velocity=still)
        for name, track in episode.tracks.items()
    }  # fmt: skip
    return replace(episode, tracks=tracks, channels={}, states={}, attachments={})


@given(episodes().map(as_recorded))
def test_zip_to_parquet_and_mcap_keeps_every_bit(tmp_path_factory, episode):
    folder = tmp_path_factory.mktemp("zip")
    path = written(episode, folder / "a.zip")
    read = load(path)
    same_episode(episode, read)
    assert validate(path) == []
    save(read, folder / "b.mcap")
    save(read, folder / "dataset")
    same_episode(episode, load(folder / "b.mcap"))
    same_episode(episode, load(folder / "dataset"))


def test_a_folder_of_zips_is_a_folder_of_traces(tmp_path):
    episode = falling_cube().episode()
    written(episode, tmp_path / "a.zip")
    written(episode, tmp_path / "named_otherwise.trace")
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as archive:
        archive.writestr("notes.txt", "no trace")
    refs = discover(tmp_path)
    assert [(ref.path.name, ref.format) for ref in refs] == [
        ("a.zip", "zip"), ("named_otherwise.trace", "zip")
    ]  # fmt: skip
    assert refs[0].fields["length"] == len(episode)
    with pytest.raises(TraceError, match="nor a recorder's ZIP"):
        discover(tmp_path / "other.zip")


def test_a_changed_byte_of_any_member_is_noticed(tmp_path):
    path = written(falling_cube().episode(), tmp_path / "a.zip")
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
        ends = [info.header_offset + 30 + len(info.filename) for info in members]
    whole = path.read_bytes()
    for info, begin in zip(members, ends, strict=True):
        if not info.file_size:
            continue
        middle = whole.find(b"NUMPY", begin) + info.file_size // 2
        if info.filename.endswith(".json"):
            middle = begin + info.file_size // 2
        damaged = bytearray(whole)
        damaged[middle] ^= 0x10
        path.write_bytes(damaged)
        assert validate(path) != [], info.filename


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"t": np.zeros(3, np.float32)}, "1 of float64"),
        ({"position": np.zeros((9, 1, 3), np.float32)}, "position.npy has the shape"),
        ({"counts": np.full(120, -1)}, "but the frames count"),
        ({"contacts": np.zeros(7, CONTACT_POINT)}, "7 contacts, but"),
        ({"fixed_position": np.zeros((7, 3), np.float32)}, "fixed_position.npy has the shape"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(tmp_path, changed, message):
    episode = falling_cube().episode()
    changed = {k: v[: len(episode)] if k in ("counts", "action") else v for k, v in changed.items()}
    path = written(episode, tmp_path / "a.zip", **changed)
    errors = validate(path)
    assert message in " ".join(map(str, errors))


def rewritten(path, name, content, **settings):
    """The file with another content of one member."""
    with zipfile.ZipFile(path) as archive:
        members = {info.filename: archive.read(info) for info in archive.infolist()}
    with zipfile.ZipFile(path, "w", **settings) as archive:
        for member, data in (members | {name: content}).items():
            archive.writestr(member, data)


def test_files_that_claim_more_than_they_hold_take_no_memory(tmp_path):
    claim = io.BytesIO()
    facts = {"descr": "<f8", "fortran_order": False, "shape": (1 << 40,)}
    np.lib.format.write_array_header_1_0(claim, facts)
    path = written(falling_cube().episode(), tmp_path / "a.zip")
    rewritten(path, "t.npy", claim.getvalue())
    assert "other than the" in str(validate(path)[0])
    path = written(falling_cube().episode(), tmp_path / "a.zip")
    rewritten(path, "t.npy", bytes(1 << 20), compression=zipfile.ZIP_DEFLATED)
    assert "compressed" in str(validate(path)[0])


def test_objects_are_never_unpickled(tmp_path):
    path = written(falling_cube().episode(), tmp_path / "a.zip")
    content = io.BytesIO()
    np.save(content, np.array([print], object), allow_pickle=True)
    rewritten(path, "t.npy", content.getvalue())
    assert "axes of object" in str(validate(path)[0])


@pytest.mark.parametrize(
    ("about", "message"),
    [
        ({"format": "other", "version": 1}, "format 'other'"),
        ({"format": "safestage-zip", "version": 2, "header": {}}, "update safestage"),
        ([], "no JSON object"),
    ],
)
def test_other_formats_and_versions_are_refused(tmp_path, about, message):
    path = written(falling_cube().episode(), tmp_path / "a.zip")
    rewritten(path, "safestage.json", json.dumps(about))
    assert message in str(validate(path)[0])
