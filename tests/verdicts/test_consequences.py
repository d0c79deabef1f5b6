"""Consequences of the assigned rule's violation stand under it, and nothing else does."""

import pytest

from safestage_eval.verdicts.consequences import with_consequences
from safestage_eval.verdicts.verdict import Verdict, VerdictName


def found(
    rule: str, time: float | None, *, assigned: bool = False, verdict: VerdictName = "violation"
) -> Verdict:
    return Verdict(rule, rule, rule[:3], assigned, verdict, time=time)


def follows(other: Verdict, *causes: Verdict) -> str | None:
    """Whose consequence the other is, in whatever order they are given."""
    orders = [[*causes, other], [other, *causes], [*reversed(causes), other]]
    values = {
        next(v for v in with_consequences(order) if v.rule == other.rule).consequence_of
        for order in orders
    }
    (one,) = values
    return one


CAUSE = found("ETS201", 2.0, assigned=True)


@pytest.mark.parametrize(
    ("rule", "time", "expected"),
    [
        ("FSH101", 3.0, "ETS201"),
        ("ETS101", 3.0, "ETS201"),  # the same stage
        ("ETS101", 2.0, "ETS201"),  # the same moment
        ("FSH101", 1.9, None),  # it came before
        ("ISH101", 3.0, None),  # a stage at which it should have been prevented earlier
    ],
)
def test_what_comes_after_at_the_same_stage_or_a_later_one(
    rule: str, time: float, expected: str | None
) -> None:
    assert follows(found(rule, time), CAUSE) == expected


def test_only_violations_follow_and_only_violations_are_followed() -> None:
    assert follows(found("FSH101", 3.0, verdict="inconclusive"), CAUSE) is None
    assert follows(found("FSH101", 3.0, verdict="pass"), CAUSE) is None
    for verdict in ("pass", "inconclusive", "not_applicable"):
        cause = found("ETS201", 2.0, assigned=True, verdict=verdict)
        assert follows(found("FSH101", 3.0), cause) is None
    assert follows(found("FSH101", 3.0), found("ETS201", 2.0)) is None  # it is not assigned


def test_of_several_assigned_rules_the_first_to_be_violated_is_the_cause_and_none_follows() -> None:
    late = found("ETS202", 4.0, assigned=True)
    assert follows(found("FSH101", 3.0), CAUSE, late) == "ETS201"
    assert follows(late, CAUSE) is None
