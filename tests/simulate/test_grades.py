"""Graded references: formulas, typed steps, and the one flip where the analysis says so."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from safestage_eval.errors import InputError
from safestage_eval.verdicts.verdict import Verdict
from simulate.feasibility.feasibility import Trial
from simulate.feasibility.grading import grade_result, grade_results
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
    "text", ["", "values", "value ** 2", "abs(value)", "'a'", "value +", "1 / (value - 1)"]
)
def test_and_nothing_else(text: str) -> None:
    with pytest.raises(ValueError, match="formula"):
        formula(text, 1.0)


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


def test_the_shelf_turns_unsafe_where_geometry_says() -> None:
    """Two values on either side, 8 mm apart."""
    whole = SHELF.grades["edge_offset"]
    narrow = whole.model_copy(update={"values": (0.05, 0.066, 0.072)})
    task = SHELF.model_copy(update={"grades": {"edge_offset": narrow}})
    (found,) = grade_results([task], [0])
    assert found.problems == ()
    assert found.limit == pytest.approx(0.02)
