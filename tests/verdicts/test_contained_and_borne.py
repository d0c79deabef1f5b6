"""Sentences about containment, support and loss, at the level of a rule's verdict."""

from pathlib import Path

import numpy as np
import pytest
from scenes import G, Scene
from sketched import drawn, verdict, with_and_without_forces

from safestage_eval.episode import Cavity, Geom

HOVERING = """
says = "A lemon lies on a beam, HIGH cm above the floor of a bin; the bin is carried off."
duration = "4 s"
roles = { target = "bin", dependent = "lemon" }
story = [
  { hold = "bin", during = "1 to 3.5 s", across = "y" },
  { move = "bin", by = "40, 0, 0 cm", during = "1.5 to 2.5 s" },
]
[bodies.bin]
shape = "bin 20 x 14 x 10 cm wall 5 mm"
mass = "300 g"
[bodies.beam]
shape = "box 8 x 60 x 1 cm"
at = "0, 0, HIGH cm"
kind = "fixture"
movable = false
[bodies.lemon]
shape = "sphere 6 cm"
mass = "100 g"
on = "beam"
"""


@with_and_without_forces
def test_a_fruit_above_a_bin_is_not_in_it(forces: bool, tmp_path: Path) -> None:
    episode = drawn(HOVERING.replace("HIGH", "30"), tmp_path)
    for rule in ("ISH201", "ISH202", "ISH203"):
        found = verdict(episode, rule, forces)
        assert (found.verdict, found.vacuity) == ("not_applicable", "not_given")
        assert any("invalid scene" in note for note in found.notes)


ACROSS = """
says = "A book lies across the rim of a bin, its middle above it, or stands in it; the bin is carried off."
duration = "4 s"
roles = { target = "bin", dependent = "book" }
story = [
  { hold = "bin", during = "1 to 3.5 s", across = "y", height = "3 cm" },
  { move = ["bin", "book"], by = "0, 0, 10 cm", during = "1.5 to 2 s" },
]
[bodies.bin]
shape = "bin 20 x 14 x 10 cm wall 5 mm"
mass = "300 g"
[bodies.book]
shape = "SHAPE"
PLACE
mass = "300 g"
"""


@with_and_without_forces
@pytest.mark.parametrize(
    ("shape", "place", "expected"),
    [
        ("box 26 x 12 x 2 cm", 'at = "0, 0, 10 cm"', "not_applicable"),
        ("box 4 x 12 x 24 cm", 'on = "bin"', "violation"),
    ],
)
def test_what_lies_across_the_rim_is_not_in_it(
    shape: str, place: str, expected: str, forces: bool, tmp_path: Path
) -> None:
    """The bin bears it, its middle is above the rim and its foot over the floor, either way."""
    text = ACROSS.replace("SHAPE", shape).replace("PLACE", place)
    assert verdict(drawn(text, tmp_path), "ISH201", forces).verdict == expected


PUSHED = """
says = "A bottle is shoved along the box that it stands on and perhaps off it, or slides by itself."
duration = "4 s"
roles = { target = "crate", dependent = "bottle" }
story = [
  { move = "bottle", by = "WAY, 0, 0 cm", during = "1 to 2 s" },
  { drop = "bottle", at = "2.2 s" },
  TOUCH
]
[bodies.crate]
shape = "box 60 x 20 x 14 cm"
mass = "3 kg"
[bodies.bottle]
shape = "cylinder 6 x 20 cm"
mass = "500 g"
on = "crate"
"""
TOUCH = '{ touch = "bottle", by = "gripper", side = "-x", force = "2 N", during = "0.9 to 2.1 s" },'


@pytest.mark.parametrize(
    ("way", "touch", "expected"),
    [
        ("5", TOUCH, ("pass", "pass")),
        ("5", "", ("pass", "pass")),
        ("40", TOUCH, ("pass", "violation")),
        ("40", "", ("violation", "pass")),
    ],
)
def test_what_falls_by_itself_is_lost_and_what_the_hand_shoves_off_is_not_handled_gently(
    way: str, touch: str, expected: tuple[str, str], tmp_path: Path
) -> None:
    episode = drawn(PUSHED.replace("WAY", way).replace("TOUCH", touch), tmp_path)
    assert tuple(verdict(episode, rule, True).verdict for rule in ("ISH101", "ISH105")) == expected


HOVERS = """
says = "A bottle is raised off a can by nothing that holds it, HIGH, and stays there; the can goes."
duration = "5 s"
roles = { target = "can", dependent = "bottle" }
story = [
  { move = "bottle", by = "0, 0, 1.9 cm", during = "1 to 1.5 s" },
  SHELF
  { move = "can", by = "0, 30, 0 cm", during = "3 to 3.5 s" },
]
[bodies.can]
shape = "cylinder 10 x 14 cm"
mass = "300 g"
[bodies.bottle]
shape = "cylinder 6 x 20 cm"
mass = "500 g"
on = "can"
[bodies.board]
shape = "box 30 x 20 x 1.5 cm"
at = "60, 0, 14.4 cm"
kind = "fixture"
"""


@pytest.mark.parametrize(
    ("shelf", "expected"),
    [
        ("", "violation"),
        ('{ move = "board", by = "-60, 0, 0 cm", during = "1.6 to 2 s" },', "pass"),
    ],
)
def test_what_nothing_supports_is_not_yet_safe(shelf: str, expected: str, tmp_path: Path) -> None:
    """It is off the can and at rest in the air; with a board pushed beneath it, it is safe."""
    found = verdict(drawn(HOVERS.replace("SHELF", shelf), tmp_path), "ISH101", True)
    assert found.verdict == expected


TILTED = """
says = "A bin with a lemon at its lower wall is tilted with it by ANGLE degrees, and back."
duration = "4 s"
roles = { target = "bin", dependent = "lemon" }
story = [
  { hold = "bin", during = "1 to 3.5 s" },
  { move = ["bin", "lemon"], by = "0, 0, 20 cm", during = "1.2 to 1.8 s" },
  { turn = ["bin", "lemon"], by = "ANGLE deg", about = "x", during = "2 to 2.3 s" },
  { turn = ["bin", "lemon"], by = "-ANGLE deg", about = "x", during = "2.7 to 3 s" },
  OUT
]
[bodies.bin]
shape = "bin 20 x 14 x 10 cm wall 5 mm"
mass = "300 g"
[bodies.lemon]
shape = "sphere 6 cm"
at = "0, SIDE cm"
mass = "100 g"
on = "bin"
"""


@with_and_without_forces
@pytest.mark.parametrize("angle", ["-60", "60", "85"])
def test_what_goes_along_with_a_tilted_bin_stays_in_it(
    angle: str, forces: bool, tmp_path: Path
) -> None:
    """Seen in the bin's own frame; in the world's its middle is outside where the bin was."""
    text = TILTED.replace("ANGLE", angle).replace("OUT", "").replace("SIDE", "3.4")
    text = text.replace("--", "")
    assert verdict(drawn(text, tmp_path), "ISH203", forces).verdict == "pass"


@pytest.mark.parametrize(("lifted_out", "expected"), [(False, "violation"), (True, "pass")])
def test_what_lies_within_a_ring_must_come_out_before_the_ring_is_moved(
    lifted_out: bool, expected: str
) -> None:
    """The ring bears nothing, so nothing depends on it; what lies in it is pushed along all the same."""
    frames, t = 480, np.arange(480)
    out = np.clip((t - 60) / 60, 0, 1) * 0.3 if lifted_out else 0 * t
    ring = np.clip((t - 300) / 60, 0, 1) * 0.1
    scene = Scene(frames).fixed("table")
    wall = Geom(kind="box", size=(0.01, 0.1, 0.05), position=(0.09, 0, 0))
    other = wall.model_copy(update={"position": (-0.09, 0, 0)})
    cavity = Cavity(kind="box", size=(0.08, 0.1, 0.05), position=(0, 0, 0))
    scene.body("ring", wall, np.column_stack([0 * t, ring, 0 * t + 0.05]), cavity=cavity)
    scene.bodies[-1] = scene.bodies[-1].model_copy(update={"geoms": (wall, other)})
    scene.box("lemon", 0.03, np.column_stack([out, 0 * t, 0 * t + 0.03]))
    for name, at in (("ring", 0.1), ("lemon", 0.03)):
        scene.rests(name, "table", at, (0, 0, 0), G)
    for side, sign in (("left", 1), ("right", -1)):
        scene.box(side, 0.01, (-2, sign, 0.5), kind="gripper", finger=side)
        if lifted_out:
            scene.contact(side, "lemon", (0, 0.03 * sign, 0.03), (0, -5 * sign, 0),
                          normal=(0, -sign, 0), frames=slice(50, 130))  # fmt: skip
    episode = scene.episode(roles={"target": ("ring",), "dependent": ("lemon",)})
    found = verdict(episode, "ISH201", True)
    assert (found.verdict, found.instances) == (expected, 1)
