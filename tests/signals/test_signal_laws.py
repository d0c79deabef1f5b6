"""Laws of every signal of the vocabulary.

A signal that is added must be known somewhere in the scene below, or the scene must be extended.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import transforms
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import Scene

from safestage_eval.episode import Cavity, Episode, Geom, Joint, RobotFrames, Tcp
from safestage_eval.evidence.declare import Options, Signal
from safestage_eval.evidence.intervals import Interval
from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations
from safestage_eval.signals import SIGNALS

FRAMES, STARTS = 80, 30
BOX = (-1.0, -1.0, -1.0, 1.0, 1.0, 1.0)
GIVEN: dict[str, Any] = {"time": 0.05, "channel": "heat", "box": BOX, "choice": "z"}
COLUMNS = {"force": 1.0, "ratio": 0.02}
IN_THE_WORLD = {"workspace_margin"}
"""Signals that are about a place; they go along only if the place does."""

OVER_TIME = {"impulse": 0.05, "health": 0.02, "moved_by": 0.1, "tipped_by": 0.1}
"""Signals that sum or look over frames, and how much half of the frames may change them (of their
range): a touch begins where the body was at the frame before it."""


@cache
def scene() -> Episode:
    """A box stands on a tray, is gripped and lifted, faster and faster, while it turns in the hand."""
    made = Scene(FRAMES)
    s = np.maximum(np.arange(FRAMES) - STARTS, 0) / made.rate
    up = np.column_stack([0.4 * s**2, -0.2 * s**2, 1.5 * s**2])

    def lifted(*place: float) -> np.ndarray:
        return up + np.array(place)

    velocity = np.column_stack([0.8 * s, -0.4 * s, 3.0 * s]).astype(np.float32)
    turn = np.column_stack([np.cos(s**2), 0 * s, np.sin(s**2), 0 * s])
    rate = np.column_stack([0 * s, 4 * s, 0 * s]).astype(np.float32)
    made.fixed("table")
    floor = Geom(kind="box", size=(0.2, 0.15, 0.01))
    made.body("b", floor, (0.02, 0.03, 0.01), mass=0.5,
              cavity=Cavity(kind="box", size=(0.2, 0.15, 0.1), position=(0, 0, 0.11)))  # fmt: skip
    made.rests("b", "table", 0.12, (0.02, 0.03, 0), 14.7)
    brick = Geom(kind="box", size=(0.05, 0.03, 0.04))
    made.body("a", brick, lifted(0.03, 0.01, 0.06), turn, com=(0.01, 0, 0.005))
    rests = slice(0, STARTS)
    made.rests("a", "b", 0.03, (0.03, 0.01, 0.02), 9.81, frames=rests)
    made.fixed("base", (-0.6, 0, 0), kind="robot", geoms=(brick,))
    made.body("arm", brick, lifted(-0.4, 0, 0.3), kind="robot", parent="base")
    made.body("hand", brick, lifted(0.03, 0.01, 0.25), kind="gripper", parent="arm",
              tcp=Tcp(position=(0, 0, -0.1), orientation=(1, 0, 0, 0)))  # fmt: skip
    for side, sign in (("left", 1), ("right", -1)):
        pad = Geom(kind="sphere", size=(0.01,))
        made.body(side, pad, lifted(0.03 - 0.06 * sign, 0.01, 0.06), kind="gripper", finger=side,
                  parent="hand")  # fmt: skip
        for frame in range(STARTS, FRAMES):
            force = np.array([(10 + 40 * s[frame]) * sign, 1, 8])
            point = up[frame] + [0.03 - 0.05 * sign, 0.01, 0.06]
            at = slice(frame, frame + 1)
            made.contact(side, "a", point, force, (sign, 0, 0), at)
    for name in ("a", "arm", "hand", "left", "right"):
        old = made.tracks[name]
        omega = rate if name == "a" else 0 * rate
        made.tracks[name] = type(old)(old.position, old.orientation, velocity, omega)
    elbow = Joint(name="elbow", kind="revolute", body="arm", limits=(-1, 2))
    column = np.sin(5 * made.t)[:, None].astype(np.float32)
    robot = RobotFrames(column, 5 * np.cos(5 * column), 7 * column, column, np.abs(column))
    channels = {("a", "heat"): (20 + 9 * made.t).astype(np.float32)}
    header = {"joints": (elbow,), "roles": {"target": ("a",)}}
    return transforms.rebuilt(made.episode(**header), frames=robot, channels=channels)


def asked(spec: Signal, box: Sequence[float] = BOX) -> Iterator[tuple[tuple[str, ...], Options]]:
    """Ways to ask for a signal: of bodies, and of the robot where it may be asked so."""
    required = {o.name: GIVEN[o.kind] for o in spec.options if o.required}
    options = required | {name: COLUMNS[dimension] for name, dimension in spec.columns}
    if "box" in options:
        options["box"] = tuple(box)
    chosen = tuple(sorted(options.items()))
    for count in spec.variant(options).arities:
        yield (("elbow",) if spec.joints else ("a", "b")[:count]), chosen
        if spec.groups and count and spec.name != "channel":
            yield ("robot", "a")[:count], chosen


CASES = [
    (spec.name, bodies, options) for spec in SIGNALS.values() for bodies, options in asked(spec)
]
every_signal = pytest.mark.parametrize(
    "case", CASES, ids=[f"{name}-{'-'.join(bodies)}" for name, bodies, _ in CASES]
)


def measure(relations: Relations, name: str, bodies: Sequence[str], options: Options) -> Interval:
    return relations.signal(name, bodies, None, 0.5, None, options)


@cache
def here() -> Relations:
    return Relations(Signals(scene()))


def same(
    one: Interval, two: Interval, at: slice = slice(None), atol: float = 1e-9, why: Any = ""
) -> None:
    assert one.dimension == two.dimension
    for end in ("lower", "upper"):
        first, second = getattr(one, end)[at], getattr(two, end)
        np.testing.assert_allclose(first, second, rtol=1e-5, atol=atol, err_msg=str(why))


@every_signal
def test_it_is_measured_at_every_frame_and_known_somewhere(case: tuple[Any, ...]) -> None:
    found = measure(here(), *case)
    assert len(found.lower) == len(found.upper) == FRAMES
    assert (found.lower <= found.upper).all()
    assert not np.isnan(found.lower).any()
    assert not np.isnan(found.upper).any()
    assert np.isfinite(found.value[found.known]).any()
    assert found.dimension == SIGNALS[case[0]].variant(dict(case[2])).dimension


@settings(max_examples=8)
@given(st.floats(-3.1, 3.1), st.floats(-2, 2), st.floats(-2, 2))
def test_where_the_scene_stands_and_which_way_it_faces(yaw: float, x: float, y: float) -> None:
    there = Relations(Signals(transforms.moved(scene(), yaw, (x, y, 0))))
    for case in CASES:
        if case[0] not in IN_THE_WORLD:
            same(measure(here(), *case), measure(there, *case), atol=2e-5, why=case)


@settings(max_examples=8)
@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(-2, 2))
def test_a_place_goes_along_with_the_scene(x: float, y: float, z: float) -> None:
    there = Relations(Signals(transforms.moved(scene(), 0, (x, y, z))))
    box = np.add(BOX, (x, y, z, x, y, z))
    for name in IN_THE_WORLD:
        for (bodies, options), (_, moved) in zip(
            asked(SIGNALS[name]), asked(SIGNALS[name], box), strict=True
        ):
            one, two = measure(here(), name, bodies, options), measure(there, name, bodies, moved)
            same(one, two, atol=2e-6, why=name)


@settings(max_examples=4)
@given(st.permutations("abcdefgh"))
def test_what_the_bodies_are_called(letters: list[str]) -> None:
    names = dict(zip(scene().bodies, letters, strict=True))
    there = Relations(Signals(transforms.renamed(scene(), names.__getitem__)))
    for name, bodies, options in CASES:
        new = [names.get(body, body) for body in bodies]
        same(measure(here(), name, bodies, options), measure(there, name, new, options), why=name)


@settings(max_examples=4)
@given(st.randoms(use_true_random=False))
def test_the_order_of_bodies_and_contacts(random: Any) -> None:
    order = list(range(len(scene().header.bodies)))
    rows = list(range(len(scene().contacts)))
    random.shuffle(order)
    random.shuffle(rows)
    there = Relations(Signals(transforms.permuted(scene(), order, np.array(rows))))
    for case in CASES:
        same(measure(here(), *case), measure(there, *case), why=case)


@every_signal
def test_half_the_rate(case: tuple[Any, ...]) -> None:
    """A peak may have been missed then: its bounds are as wide as before or wider."""
    there = Relations(Signals(transforms.every_second(scene())))
    one, two = measure(here(), *case), measure(there, *case)
    if case[0] == "peak_force":
        assert (two.lower <= one.lower[::2]).all()
        assert (two.upper >= one.upper[::2]).all()
        return
    span = np.ptp(one.value[np.isfinite(one.value)])
    same(one, two, slice(None, None, 2), atol=OVER_TIME.get(case[0], 0.0) * span + 1e-9, why=case)


@every_signal
def test_what_comes_after_changes_nothing(case: tuple[Any, ...]) -> None:
    there = Relations(Signals(transforms.gone_on(scene(), 20)))
    one, two = measure(here(), *case), measure(there, *case)
    same(one, Interval(two.lower[:FRAMES], two.upper[:FRAMES], two.dimension), why=case)


@pytest.mark.parametrize(
    "column", ["position", "orientation", "linear_velocity", "angular_velocity"]
)
@pytest.mark.parametrize("body", ["a", "b"])
def test_a_sample_that_was_not_measured_is_not_made_up(body: str, column: str) -> None:
    """The interval there, and afterwards, holds what the whole recording measures."""
    tracks = dict(scene().tracks)
    values = getattr(tracks[body], column).copy()
    values[50] = np.nan
    tracks[body] = replace(tracks[body], **{column: values})
    there = Relations(Signals(transforms.rebuilt(scene(), tracks=tracks)))
    for case in CASES:
        one, two = measure(here(), *case), measure(there, *case)
        below, above = (two.lower > one.upper), (two.upper < one.lower)
        wrong = (below | above) & ~np.isclose(two.value, one.value, rtol=1e-5, atol=1e-6)
        assert not wrong.any(), (case, np.flatnonzero(wrong))


def lacking(what: str) -> Episode:
    """The scene without one of the things that signals need."""
    episode = scene()
    header, bodies = episode.header, episode.header.bodies
    if what == "forces":
        return transforms.rebuilt(
            episode, header=header.model_copy(update={"force_source": "none"}),
            contacts=episode.contacts.where(np.zeros(len(episode.contacts), bool)),
        )  # fmt: skip
    if what in ("geometry", "masses"):
        gone = {"geoms": ()} if what == "geometry" else {"mass": None}
        less = tuple(body.model_copy(update=gone) for body in bodies)
        return transforms.rebuilt(episode, header=header.model_copy(update={"bodies": less}))
    if what in ("joints", "gripper"):
        nothing = RobotFrames.empty(FRAMES)
        return Episode(header, episode.t, episode.tracks, episode.contacts, nothing)
    return transforms.rebuilt(episode, channels={})


@pytest.mark.parametrize("what", ["forces", "geometry", "masses", "joints", "gripper", "channel"])
def test_what_the_trace_lacks_is_unknown_and_said(what: str) -> None:
    there = Relations(Signals(lacking(what)))
    needing = [case for case in CASES if what in SIGNALS[case[0]].needs]
    assert needing
    for case in needing:
        found = measure(there, *case)
        assert not found.known.any(), case
        assert found.notes, case
