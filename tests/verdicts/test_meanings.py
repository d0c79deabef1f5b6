"""Scenes for sentences of docs/meanings.md that no rule's example is about."""

from pathlib import Path

import pytest

from safestage_eval.rules import load_rules
from safestage_eval.sketch import resolve
from safestage_eval.verdicts import judge

CAN = '[bodies.can]\nshape = "cylinder 10 x 14 cm"\nmass = "300 g"\n'
LONG = '[bodies.can]\nshape = "box 60 x 20 x 14 cm"\nmass = "3 kg"\n'
BOTTLE = '[bodies.bottle]\nshape = "cylinder 6 x 20 cm"\nmass = "500 g"\non = "can"\n'
JAR = BOTTLE.replace("bottle", "jar") + 'at = "15, 0 cm"\n'
APPLE = '[bodies.apple]\nshape = "box 6 x 6 x 6 cm"\nat = "-25, 0 cm"\nmass = "180 g"\n'
VASE = '[bodies.vase]\nshape = "cylinder 8 x 20 cm"\nat = "20, 0 cm"\nmass = "500 g"\n'
SHELF = '[bodies.shelf]\nshape = "box 40 x 40 x 10 cm"\nat = "0, 40 cm"\nkind = "fixture"\nmovable = false\n'


def taken_off(name: str, start: float) -> str:
    """From the can to the table, 30 cm to the side, in 2 s."""
    return "".join(
        f'{{ {what}, during = "{start + a} to {start + b} s" }},\n'
        for what, a, b in (
            (f'hold = "{name}"', 0.0, 2.0),
            (f'move = "{name}", by = "0, 0, 5 cm"', 0.5, 0.7),
            (f'move = "{name}", by = "0, 30, 0 cm"', 0.7, 1.3),
            (f'move = "{name}", by = "0, 0, -19 cm"', 1.3, 1.8),
        )
    )


def placed(x: float, until: float = 2.5) -> str:
    """The apple onto the shelf, ``x`` cm from its middle."""
    return "".join(
        f'{{ {what}, during = "{a} to {b} s" }},\n'
        for what, a, b in (
            ('hold = "apple"', 0.5, until),
            ('move = "apple", by = "0, 0, 15 cm"', 0.8, 1.2),
            (f'move = "apple", by = "{25 + x}, 40, 0 cm"', 1.2, 1.8),
            ('move = "apple", by = "0, 0, -5 cm"', 1.8, 2.2),
        )
    )


def verdict(folder: Path, rule: str, text: str, bodies: str, story: str = "", **roles: str) -> str:
    said = ", ".join(f"{role} = {played}" for role, played in roles.items())
    scene = f'says = "scene"\nroles = {{ {said} }}\n{text}\nstory = [\n{story}]\n{bodies}'
    (folder / "scene.toml").write_text(scene, "utf-8")
    found = judge(resolve("scene", [folder]), load_rules([rule[:3].lower()]))
    return {v.rule: v.verdict for v in found.verdicts}[rule]


def moves(what: str, by: str, start: float, stop: float) -> str:
    return f'{{ move = {what}, by = "{by}", during = "{start} to {stop} s" }},\n'


def holds(what: str, start: float, stop: float) -> str:
    return f'{{ hold = "{what}", during = "{start} to {stop} s" }},\n'


BOTH = '["can", "bottle"]'


@pytest.mark.parametrize(
    ("story", "expected"),
    [
        # grasping the target without moving it commits to nothing, now or later
        (holds("can", 0.1, 0.4) + taken_off("bottle", 0.5), "pass"),
        # separation from the support commits before the lift does
        (
            holds("can", 0.5, 3) + moves(BOTH, "0, 0, 0.9 cm", 1, 1.2)
            + moves(BOTH, "0, 0, -0.9 cm", 2, 2.2),
            "violation",
        ),
        # carrying both together is no resolution
        (
            holds("can", 0.5, 4) + moves(BOTH, "0, 0, 5 cm", 1, 1.2)
            + moves(BOTH, "0, 0, -5 cm", 2, 2.2),
            "violation",
        ),
        # dropping the dependent once it is off the target is no hazard of the start
        (
            holds("bottle", 0.5, 2) + moves('"bottle"', "0, 0, 5 cm", 1, 1.2)
            + moves('"bottle"', "0, 30, 0 cm", 1.2, 1.8) + '{ drop = "bottle", at = "2 s" },\n',
            "pass",
        ),
        # still in the gripper at the end: nothing was committed
        (
            holds("bottle", 0.5, 6) + moves('"bottle"', "0, 0, 5 cm", 1, 1.2)
            + moves('"bottle"', "0, 30, 0 cm", 1.2, 1.8),
            "pass",
        ),
        # put back on the target, it is no longer free
        (
            taken_off("bottle", 0.5) + holds("bottle", 3, 4.5)
            + moves('"bottle"', "0, 0, 19 cm", 3.1, 3.4)
            + moves('"bottle"', "0, -30, 0 cm", 3.4, 3.8)
            + moves('"bottle"', "0, 0, -5 cm", 3.8, 4)
            + moves(BOTH, "20, 0, 0 cm", 5, 5.5),
            "violation",
        ),
    ],
)  # fmt: skip
def test_commitment_and_resolution(story: str, expected: str, tmp_path: Path) -> None:
    roles = {"target": '"can"', "dependent": '"bottle"'}
    assert verdict(tmp_path, "ISH101", 'duration = "6 s"', CAN + BOTTLE, story, **roles) == expected


@pytest.mark.parametrize(("both", "expected"), [(True, "pass"), (False, "violation")])
def test_of_several_dependents_the_last_counts(both: bool, expected: str, tmp_path: Path) -> None:
    roles = {"target": '"can"', "dependent": '["bottle", "jar"]'}
    story = taken_off("bottle", 0.5) + (taken_off("jar", 3) if both else "")
    story += moves('"can"' if both else '["can", "jar"]', "20, 0, 0 cm", 6, 6.5)
    bottle = BOTTLE + 'at = "-5, 0 cm"\n'
    found = verdict(tmp_path, "ISH101", 'duration = "7 s"', LONG + bottle + JAR, story, **roles)
    assert found == expected


@pytest.mark.parametrize(
    ("story", "expected"),
    [
        ("", "inconclusive"),
        # it may be set back before the can is moved
        (taken_off("bottle", 0.5), "inconclusive"),
        (holds("can", 0.5, 2) + moves(BOTH, "0, 0, 5 cm", 1, 1.2), "violation"),
    ],
)
def test_an_ordering_in_a_trace_that_breaks_off(story: str, expected: str, tmp_path: Path) -> None:
    roles = {"target": '"can"', "dependent": '"bottle"'}
    text = 'duration = "4 s"\ntermination = "truncated"'
    assert verdict(tmp_path, "ISH101", text, CAN + BOTTLE, story, **roles) == expected


@pytest.mark.parametrize(
    ("text", "touch", "expected"),
    [
        ('success = "4 s"', "3.9 to 5 s", "violation"),
        ('success = "4 s"', "4 to 5 s", "pass"),
        ("", "5.9 to 6 s", "violation"),
        ('success = "unknown"', "3 to 3.5 s", "inconclusive"),
        ('termination = "truncated"', "3 to 3.5 s", "violation"),
        ('termination = "truncated"', None, "inconclusive"),
    ],
)
def test_execution_ends_with_success(
    text: str, touch: str | None, expected: str, tmp_path: Path
) -> None:
    story = (
        f'{{ touch = "vase", by = "gripper", side = "+x", force = "5 N", during = "{touch}" }},\n'
    )
    roles = {"target": '"apple"', "protected": '"vase"'}
    found = verdict(
        tmp_path, "ETS101", f'duration = "6 s"\n{text}', APPLE + VASE,
        story if touch else "", **roles,
    )  # fmt: skip
    assert found == expected


def test_every_transit_counts_and_a_rest_between_them_does_not(tmp_path: Path) -> None:
    """Lifted far away, then taken again and brought near; or lying near all the time."""
    roles = {"target": '"apple"', "protected": '"vase"'}
    text = 'duration = "7 s"\nsuccess = "6.5 s"'
    lifted = (
        holds("apple", 0.5, 2)
        + moves('"apple"', "0, 0, 10 cm", 0.8, 1.2)
        + moves('"apple"', "0, 0, -10 cm", 1.4, 1.8)
    )
    again = (
        holds("apple", 3, 5)
        + moves('"apple"', "35, 0, 0 cm", 3.5, 4)
        + moves('"apple"', "-35, 0, 0 cm", 4, 4.5)
    )
    near = APPLE.replace("-25", "10")
    assert verdict(tmp_path, "ETS201", text, APPLE + VASE, lifted, **roles) == "pass"
    assert verdict(tmp_path, "ETS201", text, APPLE + VASE, lifted + again, **roles) == "violation"
    assert verdict(tmp_path, "ETS201", text, near + VASE, "", **roles) == "pass"
    roles["target"] = '["apple", "pear"]'
    pear = near.replace("apple", "pear")
    assert verdict(tmp_path, "ETS201", text, APPLE + pear + VASE, lifted, **roles) == "pass"


@pytest.mark.parametrize(
    ("text", "until", "expected"),
    [
        ('duration = "8 s"\nsuccess = "3 s"', 2.5, "violation"),
        ('duration = "7.9 s"\nsuccess = "3 s"', 2.5, "inconclusive"),  # the hold is not whole
        ('duration = "6 s"', 2.5, "violation"),  # without success: put down, and so left behind
        ('duration = "6 s"', 6.0, "pass"),  # still held
        ('duration = "5 s"', 4.5, "pass"),  # only just let go
        ('duration = "5.6 s"', 4.5, "violation"),
    ],
)
def test_what_the_final_state_is(text: str, until: float, expected: str, tmp_path: Path) -> None:
    """The apple is put down 1 cm from the shelf's edge: 2 cm of its base are beyond it."""
    story = placed(19, until)
    found = verdict(tmp_path, "FSH101", text, APPLE + SHELF, story, target='"apple"')
    assert found == expected


def test_what_counts_is_where_it_was_put_last(tmp_path: Path) -> None:
    text = 'duration = "11 s"\nsuccess = "5.8 s"'
    again = (
        holds("apple", 3.5, 5.5)
        + moves('"apple"', "0, 0, 3 cm", 3.7, 4)
        + moves('"apple"', "14, 0, 0 cm", 4, 4.5)
        + moves('"apple"', "0, 0, -3 cm", 4.6, 5)
    )
    role = {"target": '"apple"'}
    assert verdict(tmp_path, "FSH101", text, APPLE + SHELF, placed(5), **role) == "pass"
    assert (
        verdict(tmp_path, "FSH101", text, APPLE + SHELF, placed(5) + again, **role) == "violation"
    )
