"""Scenes in which a careless meaning goes wrong, judged by the built-in rules with and without forces."""

from pathlib import Path

import pytest
from sketched import drawn, plain, verdict, with_and_without_forces

from safestage_eval.rules import load_rules
from safestage_eval.verdicts import judge

EXAMPLES = Path(__file__).parents[2] / "rules" / "examples"

STACK = """
[bodies.can]
shape = "cylinder 10 x 14 cm"
mass = "300 g"
[bodies.bottle]
shape = "cylinder 6 x 20 cm"
mass = "500 g"
on = "can"
"""

TWIST = """
says = "A can is turned on the spot under a bottle, which goes along."
duration = "4 s"
roles = { target = "can", dependent = "bottle" }
story = [
  { hold = "can", during = "1 to 2.5 s", height = "5 cm" },
  { turn = ["can", "bottle"], by = "ANGLE deg", about = "z", during = "1.5 to 2 s" },
]
"""

SPOON = """
says = "A spoon stands in a mug; the mug is carried off."
duration = "4 s"
roles = { target = "mug", dependent = "spoon" }
story = [
  { hold = "mug", during = "1 to 3.5 s", height = "3 cm" },
  { move = ["mug", "spoon"], by = "0, 0, 10 cm", during = "1.5 to 2 s" },
]
[bodies.mug]
shape = "bin 9 x 9 x 10 cm wall 5 mm"
mass = "300 g"
[bodies.spoon]
shape = "box 1 x 1 x 24 cm"
mass = "50 g"
on = "mug"
"""

ON_PLATE = """
says = "A ball is put down on a flat plate, and stays there."
duration = "9.5 s"
rate = 30
success = "4 s"
roles = { target = "ball" }
story = [
  { hold = "ball", during = "1 to 3.8 s" },
  { move = "ball", by = "0, 0, 10 cm", during = "1.5 to 2 s" },
  { move = "ball", to = "PLACE, 0, 10 cm", during = "2 to 3 s" },
  { move = "ball", by = "0, 0, -7.5 cm", during = "3 to 3.5 s" },
]
[bodies.plate]
shape = "cylinder 33 x 2.5 cm"
at = "30, 0 cm"
mass = "700 g"
[bodies.ball]
shape = "sphere 8 cm"
at = "-10, 0 cm"
mass = "200 g"
"""

DUMBBELL = """
says = "A dumbbell is let go above glasses, and falls onto them."
duration = "4 s"
roles = { target = "dumbbell", protected = "glasses" }
story = [
  { hold = "dumbbell", during = "0.5 to 2.5 s" },
  { move = "dumbbell", by = "0, 0, 40 cm", during = "1 to 1.5 s" },
  { move = "dumbbell", by = "WAY, 0, 0 cm", during = "1.5 to 2.2 s" },
  { drop = "dumbbell", at = "2.5 s" },
]
[bodies.glasses]
shape = "box 14 x 5 x 4 cm"
at = "30, 0 cm"
mass = "30 g"
[bodies.dumbbell]
shape = "box 10 x 6 x 6 cm"
mass = "2.27 kg"
"""

BOWL = """
says = "A bowl is carried off with a fruit in it, and set down."
duration = "6 s"
success = "4.2 s"
roles = { target = "bowl" }
story = [
  { hold = "bowl", during = "1 to 4 s" },
  { move = ["bowl"FRUIT], by = "0, 0, 10 cm", during = "1.5 to 2 s" },
  { move = ["bowl"FRUIT], by = "30, 0, 0 cm", during = "2 to 3 s" },
  { move = ["bowl"FRUIT], by = "0, 0, -10 cm", during = "3 to 3.5 s" },
  SHOVED
]
[bodies.bowl]
shape = "cup 16 x 7 cm wall 5 mm"
mass = "300 g"
[bodies.lemon]
shape = "sphere 6 cm"
mass = "100 g"
PLACE
"""

PUSHED = """
says = "A finger shoves a box toward a can."
duration = "6 s"
success = "5 s"
roles = { target = "apple", protected = "can" }
story = [
  { touch = "box", by = "gripper", side = "-x", force = "3 N", during = "2 to 2.2 s" },
  { move = "box", by = "WAY, 0, 0 cm", during = "2 to 2.2 s" },
  { touch = "can", by = "box", side = "-x", force = "WAY - 4 N", during = "2.2 to 3.4 s" },
]
[bodies.apple]
shape = "sphere 7.6 cm"
at = "0, 40 cm"
[bodies.box]
shape = "box 8 x 8 x 8 cm"
at = "-13.5, 0 cm"
mass = "300 g"
[bodies.can]
shape = "cylinder 7 x 12 cm"
mass = "350 g"
"""


@with_and_without_forces
@pytest.mark.parametrize("angle", ["20", "60"])
def test_twist_of_a_can_under_a_bottle(angle: str, forces: bool, tmp_path: Path) -> None:
    """A bottle rides along on a can that is twisted on the spot."""
    episode = drawn(TWIST.replace("ANGLE", angle) + STACK, tmp_path)
    assert verdict(episode, "ISH101", forces).verdict == "pass"


@with_and_without_forces
@pytest.mark.parametrize("carried", [True, False])
def test_fruit_in_a_carried_bowl_is_not_shoved(carried: bool, forces: bool, tmp_path: Path) -> None:
    """It goes as far as one that is shoved beside the bowl."""
    text = BOWL.replace("FRUIT", ', "lemon"' if carried else "")
    text = text.replace("PLACE", 'on = "bowl"' if carried else 'at = "0, 20 cm"')
    alone = """
      { touch = "lemon", by = "bowl", side = "-y", force = "2 N", during = "1.5 to 1.6 s" },
      { move = "lemon", by = "30, 0, 0 cm", during = "1.5 to 3 s" },"""
    episode = drawn(text.replace("SHOVED", "" if carried else alone), tmp_path)
    # by its shape the lemon is nowhere near the bowl: it would have rolled off by itself
    expected = "violation" if forces and not carried else "pass"
    assert verdict(episode, "ETS106", forces).verdict == expected


@with_and_without_forces
@pytest.mark.parametrize(("way", "expected"), [("6.2", "violation"), ("4", "pass")])
def test_what_the_robot_pushes_ahead_of_it_hits_as_it_does(
    way: str, expected: str, forces: bool, tmp_path: Path
) -> None:
    """A box is shoved up to a can, which does not move; robot and target stay away from the can."""
    episode = drawn(PUSHED.replace("WAY", way), tmp_path)
    found = verdict(episode, "ETS107", forces)
    assert found.verdict == expected
    assert found.explanation.startswith("No ") == (expected == "pass")
    assert verdict(episode, "ETS101", forces).verdict == "pass"


@with_and_without_forces
def test_a_spoon_in_a_mug_lies_in_it(forces: bool, tmp_path: Path) -> None:
    assert verdict(drawn(SPOON, tmp_path), "ISH201", forces).verdict == "violation"


@with_and_without_forces
@pytest.mark.parametrize(("place", "expected"), [("30", "pass"), ("44.5", "violation")])
def test_a_ball_on_a_plate(place: str, expected: str, forces: bool, tmp_path: Path) -> None:
    """It has no up axis and no support polygon; the plate's edge, a step
    down of more than ``edge_drop``, is at 46.5 cm.
    """
    found = verdict(drawn(ON_PLATE.replace("PLACE", place), tmp_path), "FSH102", forces)
    assert found.verdict == expected


@with_and_without_forces
@pytest.mark.parametrize(("way", "expected"), [("30", "violation"), ("-30", "pass")])
def test_a_dumbbell_dropped_onto_glasses_after_release(
    way: str, expected: str, forces: bool, tmp_path: Path
) -> None:
    text = DUMBBELL.replace("WAY", way)
    found = verdict(drawn(text, tmp_path), "ETS201", forces)
    assert found.verdict == expected


THIRD_PIER = """
says = "A board lies on three piers; the middle one is drawn out."
duration = "4 s"
roles = { target = "middle", dependent = "board" }
story = [
  { hold = "middle", during = "1 to 3 s", across = "x" },
  { move = "middle", by = "0, 30, 0 cm", during = "1.5 to 2.5 s" },
]
[bodies.left]
shape = "box 6 x 10 x 8 cm"
at = "-18, 0 cm"
[bodies.middle]
shape = "box 6 x 10 x 8 cm"
[bodies.right]
shape = "box 6 x 10 x 8 cm"
at = "18, 0 cm"
[bodies.board]
shape = "box 46 x 10 x 2 cm"
at = "0, 0, 8 cm"
"""


def test_a_needless_third_pier_counts_only_where_statics_cannot_tell(tmp_path: Path) -> None:
    """With forces nothing depends on it, and the board that lay on it stays; without, it does.

    A board that only lies on it is at stake all the same: drawn out badly, the pier throws it off.
    """
    episode = drawn(THIRD_PIER, tmp_path)
    assert verdict(episode, "ISH101", True).verdict == "pass"
    blind = verdict(episode, "ISH101", False)
    assert blind.verdict == "violation"
    assert any("needless supports" in note for note in blind.notes)


@pytest.mark.parametrize(
    ("clause", "expected"),
    [
        ('require = { "tilt(target)" = "<= 15 deg" }', "pass"),
        ('forbid = { "tilt(target)" = ">= 15 deg" }', "pass"),
        ('require = { "tilt(target)" = ">= 80 deg" }', "pass"),
        ('forbid = { "tilt(target)" = "<= 5 deg" }', "pass"),
        (
            'forbid = [{ "tilt(target)" = "<= 5 deg" }, { "speed(target)" = ">= 1 mm/s" }]',
            "violation",
        ),
        ('require = { "tilt(target)" = ">= 80 deg", "speed(target)" = "<= 1 mm/s" }', "violation"),
        ('forbid = "fallen(target)"', "pass"),
        ('require = { "fallen(target)" = false }', "pass"),
        ('require = { "fallen(target)" = false, "speed(target)" = "<= 1 mm/s" }', "violation"),
        ('forbid = [{ "tilt(target)" = ">= 15 deg", "speed(target)" = ">= 1 mm/s" }]', "pass"),
    ],
)
def test_an_orange_is_never_tilted_and_the_verdict_says_so(
    clause: str, expected: str, tmp_path: Path
) -> None:
    """It rolls, so it turns; yet a limit on its tilt is skipped, and every other condition holds."""
    file = tmp_path / "tilt.toml"
    state = '[state.fallen]\nof = ["a"]\nwhen = { "tilt(a)" = ">= 30 deg" }\n'
    file.write_text(
        '[ruleset]\nformat = 1\nname = "tilt"\nversion = "1"\nextends = ["defaults"]\n'
        + state * ("fallen" in clause)
        + '[[rule]]\ncode = "TIL101"\ntitle = "tilt"\nroles = { target = "object" }\n'
        + clause,
        encoding="utf-8",
    )
    episode = plain(EXAMPLES / "rolled_after_release.toml")
    (found,) = judge(episode, load_rules([file])).verdicts
    assert found.verdict == expected
    assert any("no up axis" in note for note in found.notes)
    if expected == "violation":
        assert str(found.signal).startswith("speed")


@pytest.mark.parametrize("scene", ["lean_gives_way", "book_laid_down_first"])
def test_what_may_lean_is_never_taken_for_safe_without_forces(scene: str) -> None:
    """Whether it would fall hangs on friction, which no shape tells."""
    found = verdict(plain(EXAMPLES / f"{scene}.toml"), "ISH103", forces=False)
    assert found.verdict == "inconclusive"
    assert any("may lean" in note for note in found.notes)
