"""Measurements beside a hole use no pose that was put into it."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import G, Scene

from safestage_eval.episode import Body, Episode, Geom, with_holes
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations

RATE, FRAMES = 120.0, 120
HOLE = slice(48, 84)
"""Frames that were not recorded."""

MATERIAL = (
    ("damage_scale", 1.0), ("damage_threshold", 0.0), ("hold_sensitivity", 0.0),
    ("impact_sensitivity", 1.0),
)  # fmt: skip


def with_hole(scene: Scene, names: tuple[str, ...], *, nan: bool) -> Episode:
    """The scene without velocities of some bodies, and without what happened in the hole."""
    keep = np.ones(FRAMES, np.bool_)
    keep[HOLE] = nan
    episode = scene.episode()
    tracks = {}
    for name, track in episode.tracks.items():
        columns = dict(track.columns)
        if name in names:
            for twist in ("linear_velocity", "angular_velocity"):
                columns[twist] = np.zeros_like(columns[twist])
            if nan:
                columns["position"] = columns["position"].copy()
                columns["position"][HOLE] = np.nan
        tracks[name] = type(track)(**{c: v if len(v) == 1 else v[keep] for c, v in columns.items()})
    number, contacts = np.cumsum(keep) - 1, episode.contacts
    contacts = contacts.where(keep[contacts.frame])
    contacts = replace(contacts, frame=number[contacts.frame].astype(np.int32))
    frames = type(episode.frames).empty(int(keep.sum()))
    return with_holes(
        replace(episode, t=episode.t[keep], tracks=tracks, _contacts=contacts, _frames=frames)
    )


@pytest.mark.parametrize("nan", [False, True])
@pytest.mark.parametrize("name", ["impact", "damage", "health"])
def test_what_moves_on_evenly_meets_nothing(name: str, nan: bool) -> None:
    t = np.arange(FRAMES) / RATE
    scene = Scene(FRAMES, RATE).fixed("table")
    scene.box("a", 0.05, np.column_stack([t - 0.4, 0 * t, 0 * t + 0.05]))
    scene.rests("a", "table", 0.05, (0, 0, 0), G)
    signals = Signals(with_hole(scene, ("a",), nan=nan))
    options = () if name == "impact" else MATERIAL
    found = signals.get(name, ["a"], options=tuple(sorted((*options, ("over", 0.05)))))
    even = 1.0 if name == "health" else 0.0
    assert (found.lower <= even + 1e-3).all()
    assert (found.upper >= even - 1e-3).all()
    assert np.allclose(found.lower[:40], even, atol=1e-3)
    assert np.allclose(found.upper[:40], even, atol=1e-3)
    if name != "health":
        assert np.allclose(found.upper[-20:], even, atol=1e-3)


@pytest.mark.parametrize("nan", [False, True])
def test_what_came_in_a_hole_to_stand_beside_goes_on_from_the_edge(nan: bool) -> None:
    """A box stands 1 cm from the edge of a table; a crate, as high, is put against it unseen."""
    scene = Scene(FRAMES, RATE).fixed("table").box("a", 0.05, (0.44, 0, 0.05))
    place = np.where((np.arange(FRAMES) < HOLE.start)[:, None], (3, 0, -0.25), (0.75, 0, -0.25))
    scene.box("crate", 0.25, place)
    scene.rests("a", "table", 0.05, (0.44, 0, 0), G)
    episode = with_hole(scene, ("crate",), nan=nan)
    found = Relations(Signals(episode)).signal("edge_margin", ["a"])
    assert np.allclose(found.lower[:40], 0.01, atol=1e-4)
    beyond = found.lower[-10]
    assert beyond > 0.05
    after = episode.t >= HOLE.stop / RATE - 1e-6
    assert (found.upper[after] >= beyond - 1e-4).all()


def robot(scene: Scene, *, movable: bool) -> Scene:
    position = np.broadcast_to(np.float32([0, 0, 0]), (FRAMES, 3))
    ball = Geom(kind="sphere", size=(0.1,))
    if movable:
        return scene.body("base", ball, position, kind="robot")
    return scene.fixed("base", kind="robot", geoms=(ball,))


@pytest.mark.parametrize("movable", [True, False])
@pytest.mark.parametrize("lost", ["base", "a", "frame"])
def test_how_far_off_something_is_takes_both_poses(lost: str, movable: bool) -> None:
    scene = robot(Scene(FRAMES, RATE), movable=movable).box("a", 0.05, (1, 0, 0.0))
    scene.bodies.append(Body(name="frame", kind="object"))
    scene.tracks["frame"] = scene.tracks["a"]
    episode = scene.episode()
    of = "frame" if lost == "frame" else "a"
    assert np.allclose(Signals(episode).get("remoteness", [of]).value, 1)
    track = episode.tracks[lost]
    gone = track.position.copy()
    gone[HOLE if len(gone) > 1 else slice(None)] = np.nan
    episode = replace(episode, tracks={**episode.tracks, lost: replace(track, position=gone)})
    known = Signals(episode).get("remoteness", [of]).known
    assert not known[HOLE].any()
    assert known[: HOLE.start].all() == (len(gone) > 1)
