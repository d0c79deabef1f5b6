"""The witness segment of a finding lies between the bodies that its signal names."""

import pytest
from scenes import Scene

from safestage_eval.verdicts import Verdict
from safestage_eval.viewer.episode.witness_segment import witness


@pytest.fixture(scope="module")
def header():
    scene = (
        Scene(3).fixed("table").box("cup", 0.03, (0, 0, 0.03)).box("vase, big", 0.03, (1, 0, 0.03))
    )
    roles = {"target": ("cup",), "protected": ("vase, big",)}
    return scene.episode(roles=roles).header


def said(header, signal, limit=None, success=2.0):
    return witness(
        Verdict("R", "", "ETS", True, "violation", signal=signal, limit=limit), header, success
    )


def test_a_clearance_is_a_segment_and_the_limit_a_shell_around_what_is_protected(header):
    gap = {"kind": "gap", "a": ["cup"], "b": ["vase, big"], "flat": False, "limit": 0.08}
    assert said(header, "clearance(cup, vase, big)", 0.08) == gap
    assert said(header, "clearance(vase, big, cup)", 0.08) == gap  # whichever comes first
    assert said(header, "clearance_xy(cup, vase, big)", 0.05)["flat"] is True
    assert said(header, "clearance(cup, vase, big)", 0.0)["limit"] is None


def test_a_displacement_is_the_way_gone_since_its_reference(header):
    assert said(header, "displacement(cup)") == {"kind": "path", "body": "cup", "since": 0.0}
    assert said(header, "displacement(cup) since success")["since"] == 2.0
    assert said(header, "displacement(cup) since success", success=None) is None


def test_other_measurements_are_reported_where_they_are_made(header):
    touch = {
        "kind": "touch",
        "name": "contact_force",
        "a": ["cup"],
        "b": ["vase, big"],
        "flat": False,
    }
    assert said(header, "contact_force(cup, vase, big)", 0.1) == touch
    assert said(header, "start of contact(vase, big, cup)") == touch | {"name": "contact"}
    assert said(header, "tilt(cup)") == {"kind": "value", "name": "tilt", "body": "cup"}
    assert said(header, "lift(cup) since end of held(cup)")["kind"] == "value"


@pytest.mark.parametrize("signal", [None, "cost", "clearance(cup, ghost)", "displacement(ghost)"])
def test_of_anything_else_nothing_is_drawn(header, signal):
    assert said(header, signal) is None
