"""An episode takes memory only as long as somebody holds it."""

import gc
import subprocess
import sys
import weakref

import pytest
from recordings import falling_cube

from safestage_eval.formats import load


@pytest.mark.parametrize("name", ["e.mcap", "dataset"])
def test_an_episode_is_freed_without_waiting_for_the_collector(tmp_path, name):
    falling_cube("e", frames=20).close(tmp_path / name)
    gc.collect()
    gc.disable()
    try:
        episode = load(tmp_path / name)
        contacts = episode.contacts
        assert len(contacts.force)
        assert contacts.of_pair(contacts.pairs[0], "force", "frame")
        assert len(episode.tracks["cube"].linear_velocity)
        held = [weakref.ref(thing) for thing in (episode, contacts, episode.tracks["cube"])]
        del episode, contacts
        assert [ref() for ref in held] == [None, None, None]
    finally:
        gc.enable()


LOOK = """
import sys
from safestage_eval.formats import load
episode = load(sys.argv[1])
assert len(episode.contacts.force) and len(episode.frames.action) and episode.content_hash
assert all(len(track.position) for track in episode.tracks.values())
print([name for name in ("pandas", "polars", "scipy", "numba") if name in sys.modules])
"""


@pytest.mark.parametrize("name", ["e.mcap", "dataset"])
def test_reading_does_not_import_what_takes_tens_of_megabytes(tmp_path, name):
    falling_cube("e", frames=20).close(tmp_path / name)
    command = [sys.executable, "-c", LOOK, str(tmp_path / name)]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "[]\n"
