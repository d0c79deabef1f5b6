"""Where a parameter is said to move verdicts one way only, it does; where it may not, none says so."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from toy import Facts, ruleset

from safestage_eval.rules import syntax as ast
from safestage_eval.rules.monotone import direction
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.rule_verdict import judge_rule
from safestage_eval.verdicts.verdict import Verdict

HEAD = """
[ruleset]
format = 1
name = "toy"
version = "1"
[param]
limit = "0 m"
lasting = "2 s"
bridge = "1 s"
[state.high]
of = ["a"]
when = { "height(a)" = ">= limit" }
[state.long]
of = ["a"]
when = { "height(a)" = ">= 0 m" }
for = "lasting"
gap = "bridge"
[state.kept]
of = ["a"]
when = { "high(a)" = true }
until = "long(b)"
[state.reset]
of = ["a", "b"]
when = { "height(b)" = ">= 0 m" }
until = "high(a)"
[[rule]]
code = "TOY101"
title = "toy"
roles = { a = "object", b = "object" }
"""
HEAD = HEAD.replace('until = "long(b)"', 'until = "end"')

SURE = [
    ('require = { "height(a)" = ">= limit" }', "limit", 1),
    ('require = { "height(a)" = "< limit" }', "limit", -1),
    ('require = { "height(a)" = ">= -limit" }', "limit", -1),
    ('require = { "high(a)" = false }', "limit", -1),
    ('require = { "height(b)" = ">= 0 m", any = ["high(a)", "long(b)"] }', "limit", 1),
    ('forbid = "high(a)"\nfor = "2 s"', "limit", -1),
    ('forbid = ["kept(a)", "long(b)"]', "limit", -1),
    ('reach = "high(a)"', "limit", 1),
    ('forbid = "high(a)"\nuntil = "long(b)"', "limit", -1),
    ('given = { "high(b)" = true }\nforbid = "long(a)"', "lasting", -1),
    ('forbid = "long(a)"', "bridge", 1),
    ('reach = "long(a)"', "bridge", -1),
    ('forbid = "high(a)"\nfor = "lasting"', "lasting", -1),
    ('reach = "high(a)"\nfor = "lasting"', "lasting", 1),
    ('require = { "high(a)" = true }', "bridge", 0),
]

UNSURE = [
    ('require = { "height(a)" = [">= limit", "<= limit"] }', "limit"),
    ('forbid = ["high(a)"]\nrequire = { "high(b)" = true }', "limit"),
    ('forbid = "long(b)"\nuntil = "high(a)"', "limit"),
    ('during = "high(a)"\nrequire = { "height(b)" = ">= 0 m" }', "limit"),
    ('at = "start of high(a)"\nrequire = { "height(b)" = ">= 0 m" }', "limit"),
    ('given = { "high(a)" = true }\nrequire = { "height(b)" = ">= 0 m" }', "limit"),
    ('forbid = "start of high(a)"', "limit"),
    ('forbid = "reset(a, b)"', "limit"),
    ('during = "first lasting of episode"\nforbid = "long(a)"', "lasting"),
]


def only_rule(text):
    rules = ruleset(HEAD + text)
    return rules, rules.rules["TOY101"]


def values_of(param):
    if param == "limit":
        return [ast.Quantity(v, "length") for v in np.arange(-2.5, 3.0, 0.5)]
    return [ast.Duration(float(v)) for v in range(6)]


def verdicts(facts, text, param):
    """Rank of the verdict under each rising value: every one judged by itself."""
    rules, rule = only_rule(text)
    players = {"a": ("a",), "b": ("b",)}
    blank = Verdict("TOY101", "toy", "TOY", True, "not_applicable")
    ranks = {"not_applicable": 0, "pass": 0, "inconclusive": 1, "violation": 2}
    return [
        ranks[judge_rule(Evaluator(facts, rules, rules.params | {param: v}, None), rule, players, blank).verdict]
        for v in values_of(param)
    ]  # fmt: skip


@pytest.mark.parametrize(("text", "param", "sign"), SURE)
def test_a_single_direction_is_recognised(text, param, sign):
    assert direction(*only_rule(text), param) == sign


@pytest.mark.parametrize(("text", "param"), UNSURE)
def test_what_may_go_either_way_is_never_promised(text, param):
    assert direction(*only_rule(text), param) is None


heights = st.lists(
    st.one_of(st.sampled_from([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0]), st.just(float("nan"))),
    min_size=8,
    max_size=8,
)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from(SURE), heights, heights, st.booleans())
def test_verdicts_move_the_way_that_is_promised(case, a, b, truncated):
    text, param, sign = case
    facts = Facts({"height(a)": a, "height(b)": b}, truncated=truncated)
    found = verdicts(facts, text, param)
    assert found == sorted(found, reverse=sign < 0)
    assert sign or len(set(found)) == 1
