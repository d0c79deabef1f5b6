"""The pages on noise and on controls."""

from __future__ import annotations

import dataclasses

import pytest

from safestage_eval.verdicts.verdict import Verdict, VerdictName
from simulate.feasibility.feasibility import SHORT_CONTROL, Trial, control_cases
from simulate.feasibility.firmness_table import controls_page, noise_page
from simulate.tasks.task import tasks

pytestmark = pytest.mark.simulate


def trial(task: str, policy: str, name: VerdictName, success: float | None = 9.0) -> Trial:
    verdict = Verdict("FSH102", "", "FSH", True, name, explanation="It fell | broke.")
    return Trial(task, 0, policy, success, (verdict,), simulated=20.0)


def noisy(task: str, lost: int) -> list[Trial]:
    kept = [trial(task, "noisy:0.01", "pass") for _ in range(15 - lost)]
    kept += [trial(task, "noisy:0.01:unsafe", "violation") for _ in range(15)]
    return kept + [trial(task, "noisy:0.01", "violation") for _ in range(lost)]


def test_a_row_counts_what_is_kept_and_says_why_the_rest_is_not() -> None:
    text = noise_page([*noisy("a_task", 2), *noisy("b_task", 0)], 0.01)
    rows = [line for line in text.splitlines() if line.startswith("| `")]
    assert rows[0] == "| `a_task` | 13/15 | 15/15 | safe, 2: FSH102 violation (It fell / broke) |"
    assert len(rows) == 1
    assert "All of 15 safe and 15 unsafe ones: `b_task`." in text
    assert "58 of 60 rollouts of 2 tasks keep it: 96.7 %" in text
    assert "keeps less than that: 1." in text


def test_reasons_are_told_apart() -> None:
    lost = trial("a_task", "noisy:0.01", "pass", None)
    given_up = dataclasses.replace(lost, verdicts=(), problem="reference: out of reach.")
    text = noise_page([lost, given_up], 0.01)
    assert "safe, 1: goal not reached" in text
    assert "safe, 1: given up (out of reach)" in text


def test_rows_of_other_tasks_stay() -> None:
    whole = noise_page([*noisy("a_task", 2), *noisy("b_task", 1)], 0.01)
    mended = noise_page(noisy("a_task", 0), 0.01, whole)
    assert mended == noise_page([*noisy("b_task", 1), *noisy("a_task", 0)], 0.01)
    assert noise_page(noisy("b_task", 1), 0.01, mended) == mended
    assert "b_task" not in noise_page(noisy("a_task", 0), 0.005, whole)


def test_controls_are_counted_and_violations_listed() -> None:
    idle = [trial(task, "idle", "pass", None) for task in ("a_task", "b_task")]
    text = controls_page([*idle, trial("b_task", "random-near-home", "violation", None)])
    assert "| `idle` | 2 | 2 | 0 | 0 |" in text
    assert "| `random-near-home` | 1 | 1 | 0 | 1 |" in text
    assert "- `b_task`, random-near-home, seed 0: FSH102: It fell | broke." in text
    assert "seed 0: 20 s" in text


def test_controls_take_the_whole_horizon_once() -> None:
    task = next(iter(tasks().values()))
    asked = [(case.seed, case.policy, case.horizon) for case in control_cases([task], [4, 7])]
    assert asked == [
        (4, "idle", None),
        (4, "random-near-home", None),
        (7, "idle", SHORT_CONTROL),
        (7, "random-near-home", SHORT_CONTROL),
    ]
    assert {case.horizon for case in control_cases([task], [4, 7], horizon=3.0)} == {3.0}
