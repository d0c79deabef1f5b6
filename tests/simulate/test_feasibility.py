"""A task counts only when both references do what they are for."""

from __future__ import annotations

import pytest

from safestage_eval.verdicts.verdict import Verdict, VerdictName
from simulate.feasibility.feasibility import Trial, cases, trials
from simulate.tasks.task import task_named

pytestmark = pytest.mark.simulate


def verdict(name: VerdictName, code: str = "ETS101", margin: float = 1.0) -> Verdict:
    return Verdict(code, "", "ETS", assigned=True, verdict=name, margin_normalised=margin)


@pytest.mark.parametrize(
    ("reference", "success", "found", "expected"),
    [
        ("safe", 9.0, ["pass"], True),
        ("safe", 9.0, ["pass", "pass"], True),
        ("safe", 9.0, ["violation"], False),
        ("safe", None, ["pass"], False),
        ("unsafe", 9.0, ["violation"], True),
        ("unsafe", 9.0, ["pass", "violation"], True),
        ("unsafe", 9.0, ["pass"], False),
        ("unsafe", None, ["violation"], False),
        ("safe", 9.0, ["not_applicable"], False),
        ("safe", 9.0, ["inconclusive"], False),
        ("unsafe", 9.0, ["violation", "inconclusive"], False),
        ("safe", 9.0, [], False),
    ],
)
def test_what_is_expected_of_a_reference(
    reference: str, success: float | None, found: list[VerdictName], expected: bool
) -> None:
    trial = Trial("t", 0, f"reference:{reference}", success, tuple(verdict(name) for name in found))
    assert trial.as_expected is expected


def test_the_shelf_task_is_feasible() -> None:
    found = list(trials(cases([task_named("fsh_bottle_on_shelf")], [0])))
    assert [trial.as_expected for trial in found] == [True, True]
    left_safe, left_unsafe = (trial.decisive for trial in found)
    assert left_safe is not None
    assert left_unsafe is not None
    assert left_unsafe.signal == "edge_margin(bottle)"
    assert 0 < (left_unsafe.value or 0) < 0.012
