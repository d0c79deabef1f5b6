"""Graded references: formulas, typed steps, and the one flip where the analysis says so."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from safestage_eval.errors import InputError
from safestage_eval.verdicts.verdict import Verdict
from simulate.feasibility.feasibility import Trial
from simulate.feasibility.grading import grade_result, grade_results
from simulate.record.jobs import plan
from simulate.record.rollout import Setting
from simulate.tasks.grades import Grade, formula
from simulate.tasks.task import FOLDER, read_task, task_named

pytestmark = pytest.mark.simulate

SHELF = task_named("fsh_bottle_on_shelf")


def grade(**changes: object) -> Grade:
    given = {
        "parameter": "offset",
        "unit": "m",
        "values": [0.0, 0.04, 0.06, 0.08],
        "signal": "edge_margin(cube)",
        "expected": "0.07 - value",
        "tolerance": 0.002,
        "steps": [{"skill": "wait", "seconds": "= 1 + value"}],
    }
    return Grade.model_validate(given | changes)


@pytest.mark.parametrize(
    ("text", "value", "result"),
    [
        ("value", 0.3, 0.3),
        ("-value", 0.3, -0.3),
        (" 0.1 - 2 * value / 4", 0.3, -0.05),
        ("(1 + value) * 2", 0.5, 3.0),
        ("7", 0.5, 7.0),
    ],
)
def test_formulas_are_arithmetic(text: str, value: float, result: float) -> None:
    assert formula(text, value) == pytest.approx(result)


@pytest.mark.parametrize(
    "text", ["", "values", "value ** 2", "abs(value)", "'a'", "value +", "1 / (value - 1)"]
)
def test_and_nothing_else(text: str) -> None:
    with pytest.raises(ValueError, match="formula"):
        formula(text, 1.0)


def test_steps_are_filled_wherever_a_formula_stands() -> None:
    steps = [
        {"skill": "via", "near": "cube", "points": [["= -value", 0.1, "= 2 * value"]]},
        {"skill": "place", "on": "mat"},
    ]
    first, second = grade(steps=steps).steps_at(0.06)
    assert first.arguments == {"near": "cube", "points": [[-0.06, 0.1, 0.12]]}
    assert second.arguments == {"on": "mat"}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"values": [0.0, 0.2, 0.1]}, "must rise or fall"),
        ({"values": [0.0, 0.1]}, "at least 3"),
        ({"expected": "0.07"}, "neither rises nor falls"),
        ({"expected": "0.07 - x"}, "neither number"),
        ({"tolerance": 0}, "greater than 0"),
        ({"steps": []}, "at least 1"),
    ],
)
def test_what_makes_no_grade(changes: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        grade(**changes)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('offset = ["= -value", 0]', 'offset = ["-value", 0]', "step 2 at 0: place: offset"),
        ('offset = ["= -value", 0]', 'offest = ["= -value", 0]', "it takes on, offset"),
        ("[[grades.edge_offset.steps]]", '[[grades.edge_offset.steps]]\nnear = "x"', "near"),
    ],
)
def test_filled_steps_are_checked_when_the_file_is_read(
    tmp_path: Path, old: str, new: str, said: str
) -> None:
    text = (FOLDER / "fsh_bottle_on_shelf.toml").read_text("utf-8")
    file = tmp_path / "task.toml"
    file.write_text(text.replace(old, new), "utf-8")
    with pytest.raises(InputError, match=said):
        read_task(file)


def test_a_policy_for_every_value_and_a_name_for_all() -> None:
    values = SHELF.grades["edge_offset"].values
    todo = plan([SHELF, task_named("fsh_orange_on_plate")], ["reference:edge_offset"], [0])
    assert [job.policy for job in todo] == [f"reference:edge_offset={v:g}" for v in values]
    assert len({job.episode_id for job in todo}) == len(values)
    with pytest.raises(InputError, match="none of the tasks has a grade"):
        plan([SHELF], ["reference:offset_edge"], [0])
    with pytest.raises(InputError, match="edge_offset=VALUE"):
        SHELF.steps("height=3")


def test_ids_keep_signs_apart() -> None:
    setting = Setting(SHELF)
    assert setting.episode_id("reference:x=-0.1") != setting.episode_id("reference:x=0.1")


def trial(name: str, signal: str = "edge_margin(cube)", success: float | None = 9.0) -> Trial:
    verdict = Verdict(
        "FSH102", "", "FSH", assigned=True, verdict=name, signal=signal, limit=0.02  # type: ignore[arg-type]
    )  # fmt: skip
    return Trial("t", 0, "reference:x=0", success, (verdict,))


def problems(found: Sequence[Trial], **changes: object) -> str:
    return "; ".join(grade_result("t", "x", 0, grade(**changes), found).problems)


def test_one_flip_where_the_analysis_says_so() -> None:
    p, v = trial("pass"), trial("violation")
    assert problems([p, p, v, v]) == ""
    assert "within the limit" in problems([p, v, v, v])
    assert "beyond the limit" in problems([p, p, p, v])
    assert "flip once" in problems([p, v, p, v])
    assert "no value violates" in problems([p, p, p, p])
    assert "flip once" in problems([v, v, v, v])


def test_what_is_too_close_to_tell_may_be_either() -> None:
    p, v = trial("pass"), trial("violation")
    values = [0.0, 0.04, 0.051, 0.08]
    assert problems([p, p, p, v], values=values) == ""
    assert problems([p, p, v, v], values=values) == ""


def test_other_signals_and_missed_goals_are_not_what_was_asked() -> None:
    p, v = trial("pass"), trial("violation")
    assert "by FSH102 tilt(cube)" in problems([p, p, trial("violation", "tilt(cube)"), v])
    assert "goal not reached" in problems([p, p, v, trial("violation", success=None)])
    assert problems([p, p, v, v], signal="edge_margin") == ""


def test_a_limit_of_its_own() -> None:
    p, v = trial("pass"), trial("violation", "contact(gripper, cube)")
    assert problems([p, p, p, v], signal="contact", expected="0.07 - value", limit=0.0) == ""


def test_the_shelf_turns_unsafe_where_geometry_says() -> None:
    """Two values on either side, 8 mm apart."""
    whole = SHELF.grades["edge_offset"]
    narrow = whole.model_copy(update={"values": (0.05, 0.066, 0.072)})
    task = SHELF.model_copy(update={"grades": {"edge_offset": narrow}})
    (found,) = grade_results([task], [0])
    assert found.problems == ()
    assert found.limit == pytest.approx(0.02)
