"""An episode takes memory only as long as somebody holds it."""

import gc
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
