"""Stores that list no folders of their own, and stores that never answer."""

import threading

import pytest
from pyarrow import fs
from studio import block, run

from safestage_eval.formats import discover, remote_path, save
from safestage_eval.formats.remote_path import as_path


class Flat:
    """Google's store as Arrow sees it: objects whose names have slashes, and no folders in lists."""

    def __init__(self, root):
        self.inner = fs.SubTreeFileSystem(str(root), fs.LocalFileSystem())

    def get_file_info(self, asked):
        if not isinstance(asked, fs.FileSelector):
            return self.inner.get_file_info(asked)
        found = self.inner.get_file_info(fs.FileSelector(asked.base_dir, recursive=asked.recursive))
        return [info for info in found if info.type == fs.FileType.File]

    def open_input_file(self, place):
        return self.inner.open_input_file(place)


class Silent:
    """Never says anything."""

    def get_file_info(self, _):
        threading.Event().wait()


def stand_in(monkeypatch, store):
    monkeypatch.setattr(remote_path, "filesystem", lambda scheme: store)


def test_folders_of_a_flat_store(tmp_path, monkeypatch):
    for i in range(2):
        save(block(f"e{i}"), tmp_path / "bucket" / "a" / "dataset")
    save(block("m"), tmp_path / "bucket" / "m.mcap")
    stand_in(monkeypatch, Flat(tmp_path))
    assert as_path("gs://bucket").names() == (["a"], ["m.mcap"])
    assert as_path("gs://bucket/a").names() == (["dataset"], [])
    ids = [ref.episode_id for ref in discover(tmp_path / "bucket")]
    assert [ref.episode_id for ref in discover("gs://bucket")] == ids


def test_a_store_that_never_answers_is_reported(monkeypatch):
    stand_in(monkeypatch, Silent())
    monkeypatch.setattr(remote_path, "ANSWER", 0.05)
    with pytest.raises(TimeoutError):
        as_path("gs://bucket").names()
    done = run("score", "gs://bucket", "-r", "fsh")
    assert done.code == 2
    assert "did not answer within 0.05 s" in done.err
