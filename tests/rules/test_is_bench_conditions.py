"""IS-Bench's conditions: each is drawn as a scene in every case, and its rule judges it as it says."""

import sys
from pathlib import Path

import pytest
from sampled import share

from safestage_eval.rules import load_rules

sys.path.append(str(Path(__file__).parents[2] / "benchmarks" / "peers"))

from is_bench_scenes import Condition, conditions, expected, verdict

RULES = load_rules(["is_bench"])
CONDITIONS = conditions()


def test_all_of_its_conditions_are_said() -> None:
    assert sum(condition.count for condition in CONDITIONS) == 321
    assert {condition.rule for condition in CONDITIONS} == set(RULES.rules)


@pytest.mark.parametrize("condition", share(CONDITIONS, 3), ids=str)
def test_its_rule_judges_every_case_as_it_says(condition: Condition) -> None:
    found = {case: verdict(condition, case, RULES) for case in condition.cases}
    assert found == {case: expected(case) for case in condition.cases}
