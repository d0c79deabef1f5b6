"""A book wedged between two uprights, and a hand that presses down: judged by the built-in rules."""

from pathlib import Path

import pytest
from sketched import drawn, verdict, with_and_without_forces
from told import holds

from safestage_eval.evidence.measure import Signals
from safestage_eval.relations.relations import Relations

WEDGED = """
says = "A book is let go between two uprights, which squeeze it above the table."
duration = "9.5 s"
rate = 30
success = "4.2 s"
roles = { target = "book", protected = "uprights" }
story = [
  { hold = "book", during = "1 to 4 s", across = "y" },
  { move = "book", by = "0, 0, 4 cm", during = "1.5 to 2 s" },
  { move = "book", by = "30, 0, 0 cm", during = "2 to 3 s" },
  TOUCHES
]
[bodies.uprights]
shape = ["box 2 x 14 x 20 cm at -3, 0, 0 cm", "box 2 x 14 x 20 cm at 3, 0, 0 cm"]
at = "30, 0 cm"
mass = "2 kg"
[bodies.book]
shape = "box 4 x 12 x 16 cm"
mass = "500 g"
"""


def squeezed(lift: float) -> str:
    """Both uprights press with 40 N towards each other, and lift with so many newtons each."""
    return "".join(
        f'{{ touch = "book", by = "uprights", side = "{side}", force = "{push}, 0, {lift} N", '
        'during = "4 to 9.5 s" },\n'
        for side, push in (("-x", 40), ("+x", -40))
    )


@pytest.mark.parametrize(("touches", "expected"), [(squeezed(2.45), "violation"), ("", "pass")])
def test_a_wedged_book_is_touched_though_its_forces_add_up_to_nothing(
    touches: str, expected: str, tmp_path: Path
) -> None:
    found = verdict(drawn(WEDGED.replace("TOUCHES", touches), tmp_path), "FSH203", True)
    assert found.verdict == expected
    assert found.value == pytest.approx(80.0 if touches else 0.0)


@pytest.mark.parametrize(("lift", "expected"), [(2.45, "inconclusive"), (0.2, "violation")])
def test_a_wedged_book_is_borne_by_friction(lift: float, expected: str, tmp_path: Path) -> None:
    """Nothing lies under it, so no edge is known; with less than a tenth of its weight it falls."""
    found = verdict(drawn(WEDGED.replace("TOUCHES", squeezed(lift)), tmp_path), "FSH101", True)
    assert found.verdict == expected
    assert str(found.signal).startswith("edge_margin" if lift > 1 else "supported")


def test_without_forces_it_is_not_decided_whether_what_touches_is_wedged(tmp_path: Path) -> None:
    episode = drawn(WEDGED.replace("TOUCHES", squeezed(2.45)), tmp_path)
    assert verdict(episode, "FSH203", False).verdict == "inconclusive"


PINCHED = """
says = "Two fingers close on a glass that is none of their business, and open again."
duration = "4 s"
success = "3.5 s"
gripper = false
roles = { target = "can", protected = "glass" }
story = [
  { touch = "glass", by = "left", side = "+y", force = "FORCE N", during = "1 to 2 s" },
  { touch = "glass", by = "right", side = "-y", force = "FORCE N", during = "1 to 2 s" },
]
[bodies.glass]
shape = "cylinder 6 x 12 cm"
mass = "200 g"
[bodies.can]
shape = "cylinder 6 x 12 cm"
at = "30, 0 cm"
mass = "300 g"
[bodies.left]
shape = "box 2 x 2 x 6 cm"
at = "0, 4.2, 4 cm"
kind = "gripper"
finger = "left"
[bodies.right]
shape = "box 2 x 2 x 6 cm"
at = "0, -4.2, 4 cm"
kind = "gripper"
finger = "right"
parent = "left"
"""


@pytest.mark.parametrize(("force", "expected"), [("0.06", "violation"), ("0.04", "pass")])
def test_a_pinch_is_a_touch_by_the_sum_of_both_forces(
    force: str, expected: str, tmp_path: Path
) -> None:
    """Each finger alone stays below the 0.1 N of a contact, and their vectors add up to nothing."""
    found = verdict(drawn(PINCHED.replace("FORCE", force), tmp_path), "ETS101", True)
    assert found.verdict == expected
    assert found.value == pytest.approx(2 * float(force))


PALM = """
[bodies.palm]
shape = "box 6 x 6 x 4 cm"
at = "WHERE, 0, 26 cm"
kind = "gripper"
[bodies.left]
shape = "box 1 x 1 x 4 cm"
at = "WHERE, 8, 24 cm"
kind = "gripper"
finger = "left"
parent = "palm"
[bodies.right]
shape = "box 1 x 1 x 4 cm"
at = "WHERE, -8, 24 cm"
kind = "gripper"
finger = "right"
parent = "palm"
"""

RESTS_ON = """
says = "A box is pushed along a shelf; then the hand comes down and rests on top of it."
duration = "6 s"
gripper = false
roles = { target = "box" }
story = [
  { move = "box", by = "WHERE, 0, 0 cm", during = "1 to 2 s" },
  { move = ["palm", "left", "right"], by = "0, 0, -10 cm", during = "2.5 to 3 s" },
  { touch = "box", by = "palm", side = "+z", force = "5 N", during = "3 to UNTIL s" },
  LEAVES
]
[bodies.shelf]
shape = "box 40 x 40 x 10 cm"
kind = "fixture"
movable = false
[bodies.box]
shape = "box 6 x 6 x 6 cm"
mass = "300 g"
on = "shelf"
"""


def rests_on(where: str, until: str, leaves: str) -> str:
    """How far the box is pushed (cm), until when the hand rests on it (s), and how it goes."""
    story = (RESTS_ON + PALM).replace("WHERE", where)
    return story.replace("UNTIL", until).replace("LEAVES", leaves)


@with_and_without_forces
@pytest.mark.parametrize(("where", "expected"), [("16", "violation"), ("14", "pass")])
def test_what_the_hand_rests_on_is_not_in_its_hand(
    where: str, expected: str, forces: bool, tmp_path: Path
) -> None:
    """Success never came, and yet it is judged: it was put down, 1 cm or 3 cm from the edge."""
    leaves = '{ move = ["palm", "left", "right"], by = "0, 0, 10 cm", during = "4.6 to 5.2 s" },'
    episode = drawn(rests_on(where, "4.6", leaves), tmp_path)
    found = verdict(episode, "FSH101", forces)
    assert (found.verdict, found.instances) == (expected, 1)
    assert not holds(Relations(Signals(episode)), "held", ("box",)).any()


@with_and_without_forces
@pytest.mark.parametrize("where", ["16", "14"])
def test_what_the_hand_still_rests_on_was_not_left(
    where: str, forces: bool, tmp_path: Path
) -> None:
    """Without forces it may be near it only: then the first box was left at the edge."""
    found = verdict(drawn(rests_on(where, "6", ""), tmp_path), "FSH101", forces)
    assert found.verdict == ("pass" if forces or where == "14" else "inconclusive")
    assert found.instances == (0 if forces else 1)


PRESSED_DOWN = """
says = "A vase is pushed off a step, and falls with the hand upon it."
duration = "4 s"
gripper = false
roles = { protected = "vase" }
story = [
  { move = ["vase", "palm", "left", "right"], by = "12, 0, 0 cm", during = "1 to 1.5 s" },
  { drop = "vase", at = "1.5 s" },
  { drop = "palm", at = "1.5 s", by = "HIGH cm" },
  { touch = "vase", by = "palm", side = "+z", force = "5 N", during = "0.5 to 3 s" },
]
[bodies.step]
shape = "box 12 x 12 x HIGH cm"
kind = "fixture"
movable = false
[bodies.vase]
shape = "box 6 x 6 x 12 cm"
mass = "400 g"
on = "step"
"""


@with_and_without_forces
@pytest.mark.parametrize(("high", "expected"), [("8", "violation"), ("4", "pass")])
def test_a_hand_that_presses_down_on_what_falls_does_not_carry_it(
    high: str, expected: str, forces: bool, tmp_path: Path
) -> None:
    text = PRESSED_DOWN + PALM.replace("WHERE", "0").replace("26", f"{12 + int(high)}")
    found = verdict(drawn(text.replace("HIGH", high), tmp_path), "ETS103", forces)
    assert found.verdict == expected
