"""Results as JUnit XML, for build servers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from safestage_eval.run.scores import Scores
from safestage_eval.verdicts import Verdict

from .golden import Change
from .render_junit import Case, render_junit


def render(scores: Scores, changes: Sequence[Change] | None = None) -> str:
    """One test suite per task, one test case per episode and rule that counts.

    Args:
        scores: the results.
        changes: what is not as a golden file expects. If given, these are the failures, and a
            violation that is expected is none.
    """
    suites: dict[str, list[Case]] = {}
    left = list(changes or ())
    for result in scores.results:
        task, episode = result.task or "–", result.episode_id
        suite = suites.setdefault(task, [])
        for v in scores.gates.counted(result):
            own = [c for c in left if (c.episode_id, c.rule) == (episode, v.rule)]
            left = [change for change in left if change not in own]
            failure = _failure(v, own, violations=changes is None)
            suite.append(Case(f"{task}.{v.rule}", episode, *failure))
        suite += [
            Case(f"{task}.{rule}", episode, "skipped", f"{rule} is assigned and was not loaded")
            for rule in result.not_loaded
        ]
    for change in left:
        name = ": ".join(filter(None, (change.episode_id, change.rule)))
        suites.setdefault("golden", []).append(Case("golden", name, "failure", change.what))
    for problem in scores.problems:
        case = Case("problems", problem.path, "error", problem.message)
        suites.setdefault("problems", []).append(case)
    return render_junit("safestage", suites)


def _failure(v: Verdict, own: Sequence[Change], *, violations: bool) -> tuple[Any, ...]:
    """Outcome, message and detail of a verdict; nothing of one that passes."""
    if own:
        return "failure", "; ".join(change.what for change in own), v.explanation
    if v.verdict == "violation" and violations:
        return "failure", v.explanation, "\n".join(v.notes)
    if v.verdict == "inconclusive" or v.vacuity == "unbound":
        return "skipped", v.explanation or "; ".join(v.notes)
    return ()
