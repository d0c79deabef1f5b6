"""Recordings without contacts whose shapes and poses cannot both be right."""

import numpy as np
import pytest
from scenes import Scene

from safestage_eval.audit import choose
from safestage_eval.audit.audit_episode import check_subject
from safestage_eval.audit.subject import Subject
from safestage_eval.episode import Geom
from safestage_eval.rules import builtin_names, load_rules

CODES = ("AUD211", "AUD212", "AUD210", "AUD201", "AUD204")
HALF = 0.02


def found(episode):
    rules = load_rules(builtin_names())
    return {f.code: f for f in check_subject(Subject(episode, rules), choose(CODES))}


def lifted(pad=0.0, *, thick=0.01):
    """A cube that two pads come to and lift by 10 cm; ``pad``: m by which each is off, outward."""
    s = Scene(60, 20.0).fixed("table")
    path = np.column_stack([0 * s.t, 0 * s.t, HALF + 0.1 * np.clip(s.t - 1, 0, 1)])
    s.box("cube", HALF, path)
    return with_pads(s, path, np.where(s.t < 0.8, 0.2, pad), thick)


def with_pads(s, path, off, thick=0.01):
    for side, sign in (("left", 1), ("right", -1)):
        at = path + np.multiply.outer(np.broadcast_to(HALF + 0.01 + off, s.frames), (0, sign, 0))
        s.box(f"{side}_pad", (0.01, thick, 0.01), at, kind="gripper", finger=side, mass=0.1)
    return s.episode()


def test_held_between_its_pads_it_is_borne():
    assert not found(lifted())
    assert not found(lifted(0.0015))


@pytest.mark.parametrize("pad", [0.003, 0.01, 0.05])
def test_a_pad_that_is_off_bears_nothing(pad):
    finding = found(lifted(pad))["AUD211"]
    assert f"_pad' comes nearest, {1000 * pad:.0f} mm away" in finding.what
    assert finding.place.bodies[0] == "cube"
    assert finding.place.time == pytest.approx(1.0, abs=0.2)


def test_what_falls_needs_nothing_that_bears_it():
    s = Scene(60, 20.0).fixed("table")
    high = HALF + 0.5 * 9.81 * 0.7**2
    fall = np.maximum(HALF, high - 0.5 * 9.81 * np.clip(s.t - 1, 0, None) ** 2)
    s.box("cube", HALF, np.column_stack([0 * s.t, 0 * s.t, fall]))
    held = np.tile([0, 0, high], (s.frames, 1))
    assert "AUD211" not in found(with_pads(s, held, np.where(s.t > 1, 0.03, 0)))


def test_a_pad_too_thick_goes_through_what_it_holds():
    finding = found(lifted(0.02, thick=0.04))["AUD212"]
    assert "overlap by 10 mm" in finding.what
    assert not found(lifted(thick=0.013))


@pytest.mark.parametrize("yaw", [20, 60, 110])
def test_a_quaternion_in_another_order_rests_on_an_edge(yaw):
    half = np.radians(yaw) / 2
    s = Scene(30, 20.0).fixed("table")
    right = (np.cos(half), 0, 0, np.sin(half))
    s.body("cube", Geom(kind="box", size=(HALF,) * 3), (0, 0, HALF), right)
    assert not found(s.episode())
    s = Scene(30, 20.0).fixed("table")
    s.body(
        "cube", Geom(kind="box", size=(HALF,) * 3), (0, 0, HALF), (right[1], *right[2:], right[0])
    )
    assert f"tilted by {yaw}°" in found(s.episode())["AUD210"].what


@pytest.mark.parametrize("kind, size", [("sphere", (HALF,)), ("cylinder", (HALF, HALF)),
                                        ("capsule", (HALF, 0.01)), ("ellipsoid", (0.03, HALF, 0.01))])  # fmt: skip
@pytest.mark.parametrize(
    "turn", [(1, 0, 0, 0), (0.5**0.5, 0.5**0.5, 0, 0), (0.5**0.5, 0, 0.5**0.5, 0)]
)
def test_shapes_that_rest_as_they_may(kind, size, turn):
    s = Scene(30, 20.0)
    s.body("thing", Geom(kind=kind, size=size), (0, 0, 0.5), turn)
    assert "AUD210" not in found(s.episode())


def test_what_leans_on_another_body_may_be_tilted():
    s = Scene(30, 20.0).fixed("table").box("wall", (0.01, 0.1, 0.1), (0.061, 0, 0.1))
    turn = (np.cos(np.radians(15)), 0, np.sin(np.radians(15)), 0)
    s.body("book", Geom(kind="box", size=(0.005, 0.05, 0.08)), (0.0, 0, 0.0718), turn)
    assert "AUD210" not in found(s.episode())


def test_how_far_below_the_next_thing_is():
    s = Scene(30, 20.0).fixed("table", (0, 0, -0.46)).box("cube", HALF, (0, 0, HALF))
    s.box("pad", 0.01, (0.5, 0, 0.5), kind="gripper", finger="left")
    assert "'table' is 46.0 cm below it" in found(s.episode())["AUD204"].what
