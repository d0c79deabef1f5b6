"""Values of parameters that commands, headers and bind files set."""

import pytest

from safestage_eval.errors import RuleError
from safestage_eval.rules import load_rules, parse_overrides
from safestage_eval.rules.syntax import amount

RULES = load_rules(["ets"])


@pytest.mark.parametrize("text", ["7 cm", "70 mm", "0.07 m"])
def test_a_value_is_the_same_in_any_unit(text: str) -> None:
    assert amount(parse_overrides(RULES, {"min_clearance": text})["min_clearance"]) == 0.07


@pytest.mark.parametrize(
    ("name", "text", "what"),
    [
        ("min_clearence", "7 cm", "no loaded rule file has a parameter"),
        ("min_clearance", "7", "has no unit"),
        ("min_clearance", "7 N", "is in force"),
        ("min_clearance", "near", "min_clearance"),
    ],
)
def test_what_is_no_value_of_the_parameter_is_refused(name: str, text: str, what: str) -> None:
    with pytest.raises(RuleError, match=what):
        parse_overrides(RULES, {name: text})
