"""Worker processes: forked from one that has loaded libraries where that works, else spawned."""

from multiprocessing.context import SpawnContext

import pytest

from safestage_eval._process import spawned


@pytest.mark.skipif(not spawned.FORKS, reason="processes are always spawned here")
def test_a_long_temporary_folder_has_no_room_for_the_socket(monkeypatch):
    assert not isinstance(spawned._context("json"), SpawnContext)
    folder = "/tmp/" + "x" * 90
    monkeypatch.setattr(spawned, "get_temp_dir", lambda: folder)
    assert isinstance(spawned._context("json"), SpawnContext)
    spawned.prepare("json")  # starts nothing, and does not fail
