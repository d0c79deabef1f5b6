"""The content hash changes with what was measured and with nothing else."""

from dataclasses import fields, replace

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st
from recordings import falling_cube
from strategies import episodes

from safestage_eval.episode import Body, Header, Track


def with_header(episode, **changes):
    return replace(episode, header=episode.header.model_copy(update=changes))


@given(episodes(max_frames=4))
def test_names_and_judgements_do_not_matter(episode):
    renamed = with_header(
        episode, episode_id="other", task="x", seed=7, success=True, roles={}, rules=("ISH101",)
    )
    tagged = with_header(
        episode,
        bodies=tuple(
            body.model_copy(update={"tags": ("sharp",), "material": "glass"})
            for body in episode.header.bodies
        ),
    )
    assert renamed.content_hash == tagged.content_hash == episode.content_hash


@given(episodes(max_frames=4), st.data())
def test_one_changed_bit_of_a_track_matters(episode, data):
    name = data.draw(st.sampled_from(list(episode.tracks)))
    column = data.draw(st.sampled_from([f.name for f in fields(Track)]))
    track = episode.tracks[name]
    changed = getattr(track, column).copy()
    changed.view(np.uint32).flat[data.draw(st.integers(0, changed.size - 1))] ^= 1
    other = replace(episode, tracks={**episode.tracks, name: replace(track, **{column: changed})})
    assert other.content_hash != episode.content_hash


@given(episodes(max_frames=4))
def test_scene_time_and_contacts_matter(episode):
    heavier = tuple(b.model_copy(update={"mass": 9.0}) for b in episode.header.bodies)
    assert with_header(episode, bodies=heavier).content_hash != episode.content_hash
    assert with_header(episode, physics_dt=0.003).content_hash != episode.content_hash
    later = replace(episode, t=episode.t + 1)
    assert later.content_hash != episode.content_hash
    assume(len(episode.contacts))
    fewer = episode.contacts.where(np.arange(len(episode.contacts)) > 0)
    assert replace(episode, _contacts=fewer).content_hash != episode.content_hash


def test_a_field_of_a_later_minor_leaves_older_hashes_as_they_are():
    class LaterBody(Body):
        temperature: float | None = None

    class LaterHeader(Header):
        bodies: tuple[LaterBody, ...] = ()

    episode = falling_cube().episode()
    later = LaterHeader.model_validate(episode.header.model_dump())
    assert later.bodies[0].temperature is None
    assert replace(episode, header=later).content_hash == episode.content_hash
