"""Unmeasured values are unknown, and no others."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import G, Scene
from told import doubt_of, holds

from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations

LOST = slice(20, 30)


def resting(frames=60, push=0.0):
    scene = Scene(frames).fixed("table").box("a", 0.05, (0, 0, 0.05)).box("b", 0.05, (0.3, 0, 0.05))
    for name, x in (("a", 0.0), ("b", 0.3)):
        scene.rests(name, "table", 0.05, (x, 0, 0), G)
    if push:
        scene.contact("b", "a", (0.1, 0, 0.05), (-push, 0, 0), normal=(-1, 0, 0))
    return scene.episode()


def with_nan(episode, body, column, at=LOST):
    track = episode.tracks[body]
    values = getattr(track, column).copy()
    values[at] = np.nan
    return replace(episode, tracks={**episode.tracks, body: replace(track, **{column: values})})


def with_contacts(episode, column, by, at=LOST):
    contacts = episode.contacts
    values = getattr(contacts, column).copy()
    rows = (contacts.frame >= at.start) & (contacts.frame < at.stop) & (contacts.body2 == 1)
    values[rows] = by(values[rows])
    return replace(episode, _contacts=replace(contacts, **{column: values}))


def lost(series):
    return np.flatnonzero(~series.known)


@pytest.mark.parametrize(
    ("signal", "column"),
    [
        ("displacement", "position"),
        ("height", "position"),
        ("turn", "orientation"),
        ("tilt", "orientation"),
        ("lift", "orientation"),
    ],
)
def test_a_body_whose_pose_is_nan_is_unknown_there_alone(signal, column):
    episode = with_nan(resting(), "a", column)
    signals = Signals(episode)
    assert lost(signals.get(signal, ["a"])).tolist() == [*range(20, 30)]
    assert signals.get(signal, ["b"]).known.all()
    where, whole = (Signals(e).get(signal, ["a"]) for e in (episode, resting()))
    assert np.array_equal(where.lower[where.known], whole.lower[where.known])


def test_velocities_that_are_all_nan_were_not_recorded():
    episode = with_nan(resting(), "a", "linear_velocity", slice(None))
    assert Signals(episode).get("speed", ["a"]).known.all()


def test_nothing_is_known_at_frames_that_nobody_saw():
    unseen = np.zeros(60, np.bool_)
    unseen[LOST] = True
    episode = replace(resting(), unseen=unseen)
    relations = Relations(Signals(episode))
    for name, bodies in (("displacement", "a"), ("contact_force", "at"), ("edge_margin", "a")):
        names = [{"a": "a", "t": "table"}[x] for x in bodies]
        assert lost(relations.signal(name, names))[:10].tolist() == [*range(20, 30)], name
    told = relations.told("supported", ["a"])
    assert np.flatnonzero(told.lower < told.upper).tolist() == [*range(20, 30)]


@pytest.mark.parametrize(
    ("column", "by", "why"),
    [
        ("normal", lambda n: n * 2, "unit length"),
        ("normal", lambda n: n * 0, "unit length"),
        ("normal", lambda n: -n, "pulls"),
        ("force", lambda f: -f, "pulls"),
        ("force", lambda f: f * np.nan, "NaN"),
        ("normal", lambda n: n * np.nan, "NaN"),
    ],
)
def test_a_contact_that_cannot_be_makes_the_force_of_its_pair_unknown(column, by, why):
    episode = with_contacts(resting(), column, by)
    relations = Relations(Signals(episode))
    found = relations.signal("contact_force", ["a", "table"])
    assert (found.upper[LOST] == np.inf).all()
    assert (found.lower[LOST] >= 0).all()
    assert found.upper[0] == found.lower[0] == pytest.approx(G)
    [note] = found.notes
    assert why in note
    assert "table and a" in note
    assert "10 frames from 0.167 s on" in note
    assert np.isfinite(relations.signal("contact_force", ["b", "table"]).upper).all()
    assert doubt_of(relations, "supports", ("table", "a"))[0][LOST].all()
    assert doubt_of(relations, "supports", ("table", "b")) is None


def test_forces_that_are_zero_though_bodies_rest_were_not_recorded():
    episode = resting()
    zero = replace(
        episode.contacts,
        force=np.zeros_like(episode.contacts.force),
        peak_force=np.zeros_like(episode.contacts.peak_force),
    )
    for contacts in (zero, None):
        signals = Signals(replace(episode, _contacts=contacts))
        found = signals.get("contact_force", ["a", "table"])
        assert not found.known.any()
        assert "all are zero" in found.notes[0]
        assert holds(Relations(signals), "supported", ["a"]).all()  # by geometry


def pressed_by_all(peaks):
    """The peak of all forces on a box, of those of the table alone; ``peaks``: N, by pair."""
    episode = resting(push=3.0)
    contacts = episode.contacts
    values = np.where(contacts.body1 == 0, *peaks).astype(np.float32)
    episode = replace(episode, _contacts=replace(contacts, peak_force=values))
    scene = episode.header.model_copy(
        update={
            "bodies": tuple(
                b if b.name == "a" else b.model_copy(update={"kind": "robot", "movable": True})
                for b in episode.header.bodies
            )
        }
    )
    tracks = {name: track.over(60) for name, track in episode.tracks.items()}
    whole = Signals(replace(episode, header=scene, tracks=tracks))
    return whole.get("peak_force", ["robot", "a"]), Signals(episode).get(
        "peak_force", ["a", "table"]
    )


def test_the_peak_of_several_pairs_is_between_the_largest_and_their_sum():
    found, alone = pressed_by_all((40.0, 7.0))
    assert found.lower[0] == pytest.approx(40)
    assert found.upper[0] == pytest.approx(47)
    assert alone.lower[0] == alone.upper[0] == 40


def falling(frames=60, rate=120.0, touching=False):
    t = np.arange(frames) / rate
    path = np.stack([0 * t, 0 * t, 2 - G * t * t / 2], 1)
    scene = (
        Scene(frames, rate)
        .fixed("table")
        .box("a", 0.05, path)
        .box("b", 0.05, path + np.array([0, 0, 0.1]))
    )
    if touching:
        scene.contact("a", "b", (0, 0, 2), (0, 0, 0))
    return scene.episode()


@pytest.mark.parametrize(
    ("frames", "rate", "touching", "recorded"),
    [
        (6, 120.0, True, False),
        (2, 10.0, True, False),
        (6, 120.0, False, False),
        (14, 120.0, True, True),
        (6, 30.0, True, True),
        (6, 5.0, True, False),
    ],
)
def test_zero_forces_of_what_is_too_short_or_coarse_to_tell_were_not_recorded(
    frames, rate, touching, recorded
):
    """Two boxes fall side by side: their contacts bear nothing, if there is time to see it."""
    assert Signals(falling(frames, rate, touching)).gaps.forces is recorded


@pytest.mark.parametrize("way", ["NaN", "unseen"])
def test_a_place_that_was_not_measured_is_no_rest(way):
    episode, lost = falling(), np.zeros(60, np.bool_)
    lost[20:50] = True
    if way == "NaN":
        for name in "ab":
            episode = with_nan(episode, name, "position", slice(20, 50))
    else:
        tracks = {}
        for name in "ab":
            track = episode.tracks[name]
            held = track.position.copy()
            held[lost] = held[20]
            tracks[name] = replace(track, position=held)
        episode = replace(episode, unseen=lost, tracks={**episode.tracks, **tracks})
    assert Signals(episode).gaps.forces
