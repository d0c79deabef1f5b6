"""The pieces of a parameter agree with judging each value, for small rules on made-up heights."""

import itertools
from math import isnan

from hypothesis import example, given, settings
from hypothesis import strategies as st
from toy import Facts, ruleset

from safestage_eval.rules import syntax as ast
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.verdicts.rule_verdict import judge_rule
from safestage_eval.verdicts.verdict import Verdict, at_risk
from safestage_eval.whatif.flips import pieces_of
from safestage_eval.whatif.swept_values import like

HEAD = """
[ruleset]
format = 1
name = "toy"
version = "1"
[param]
limit = "{limit} m"
lasting = "{lasting} s"
bridge = "{bridge} s"
[state.high]
of = ["a"]
when = { "height(a)" = ">= limit" }
[state.long]
of = ["a"]
when = { "height(a)" = ">= 0 m" }
for = "lasting"
gap = "bridge"
[state.high_long]
of = ["a"]
when = { "high(a)" = true }
for = "lasting"
gap = "1 s"
[state.long_long]
of = ["a"]
when = { "long(a)" = true, "height(a)" = "<= 1 m" }
for = "lasting"
[state.kept]
of = ["a"]
when = { "high(a)" = true }
until = "end"
[state.until_long]
of = ["a", "b"]
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

DECIDED = [
    ('require = { "height(a)" = ">= limit" }', "limit"),
    ('require = { "height(a)" = "< limit" }', "limit"),
    ('require = { "height(a)" = "> limit" }', "limit"),
    ('require = { "height(a)" = ">= -limit" }', "limit"),
    ('require = { "height(a)" = "< -limit" }', "limit"),
    ('require = { "high(a)" = false }', "limit"),
    ('require = { "height(b)" = ">= 0 m", any = ["high(a)", "long(b)"] }', "limit"),
    ('forbid = "high(a)"\nfor = "2 s"', "limit"),
    ('forbid = ["kept(a)", "long(b)"]', "limit"),
    ('reach = "high(a)"', "limit"),
    ('reach = "high(a)"\nfor = "2 s"', "limit"),
    ('forbid = "high(a)"\nuntil = "long(b)"', "limit"),
    ('given = { "high(b)" = true }\nforbid = "long(a)"', "lasting"),
    ('given = { "high(b)" = true }\nforbid = "long(a)"', "limit"),
    ('forbid = "long(a)"', "lasting"),
    ('reach = "long(a)"', "lasting"),
    ('forbid = "high(a)"\nfor = "lasting"', "lasting"),
    ('reach = "high(a)"\nfor = "lasting"', "lasting"),
    ('forbid = "high_long(a)"', "limit"),
    ('forbid = "high_long(a)"', "lasting"),
    ('forbid = "long_long(a)"', "lasting"),
    ('reach = "long_long(a)"', "lasting"),
    ('require = { "height(a)" = [">= limit", "<= 1 m"] }', "limit"),
    ('require = { "height(a)" = ">= limit", "height(b)" = "<= limit" }', "limit"),
    ('forbid = ["high(a)"]\nrequire = { "high(b)" = true }', "limit"),
    ('during = "high(a)"\nrequire = { "height(b)" = ">= 0 m" }', "limit"),
    ('during = "high(a)"\nforbid = "high(b)"\nfor = "2 s"', "limit"),
    ('during = "from high(a) to high(b)"\nforbid = "long(b)"', "limit"),
    ('given = { "high(a)" = true }\nrequire = { "height(b)" = ">= 0 m" }', "limit"),
    ('forbid = "start of high(a)"', "limit"),
    ('forbid = "end of high(a)"', "limit"),
    ('forbid = "reset(a, b)"', "limit"),
    ('forbid = "until_long(a, b)"', "limit"),
    ('forbid = "until_long(a, b)"', "lasting"),
    ('during = "first lasting of episode"\nforbid = "high(a)"', "lasting"),
    ('during = "last lasting of episode"\nrequire = { "height(a)" = ">= 0 m" }', "lasting"),
    ('during = "lasting after start of high(a)"\nrequire = { "height(b)" = ">= 0 m" }', "lasting"),
]
"""Obligations with a parameter that they read."""

LEFT_OPEN = [
    ('forbid = "long(a)"', "bridge"),
    ('forbid = "long(b)"\nuntil = "high(a)"', "limit"),
    ('at = "start of high(a)"\nrequire = { "height(b)" = ">= 0 m" }', "limit"),
    ('during = "high(a)"\nreach = "high(b)"', "limit"),
    ('during = "first lasting of episode"\nforbid = "long(a)"', "lasting"),
    ('during = "first lasting of (last lasting of episode)"\nforbid = "long(a)"', "lasting"),
]
"""Likewise; their pieces may be undecided, but never wrong."""

HEIGHTS = st.lists(
    st.one_of(st.sampled_from([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0]), st.just(float("nan"))),
    min_size=8,
    max_size=8,
)
PLAYERS = {"a": ("a",), "b": ("b",)}
BLANK = Verdict("TOY101", "toy", "TOY", True, "not_applicable")


def told(facts, text, param, values, number):
    """(verdict and risk by the pieces, by judging) under a number."""
    head = HEAD
    for name, value in values.items():
        head = head.replace(f"{{{name}}}", str(value))
    rules = ruleset(head + text)
    rule = rules.rules["TOY101"]
    base = Evaluator(facts, rules, rules.params, None)
    line = pieces_of(base, rule, PLAYERS, param)
    assert line[0].low == 0
    assert all(a.high == b.low for a, b in itertools.pairwise(line))
    (piece,) = [piece for piece in line if piece.low <= number < piece.high]
    other = rules.params | {param: like(rules.params[param], number)}
    now = judge_rule(Evaluator(facts, rules, other, None), rule, PLAYERS, BLANK)
    return piece, (now.verdict, at_risk(now.verdict, now.instances, now.vacuity))


NUMBERS = st.one_of(
    st.sampled_from([0.0, 0.5, 1.0, 2.0, 3.0]), st.floats(0, 9), st.integers(0, 9).map(float)
)
VALUES = st.fixed_dictionaries(
    {
        "limit": NUMBERS.map(lambda x: round(x, 3)),
        "lasting": st.integers(0, 6),
        "bridge": st.integers(0, 3),
    }
)


@settings(max_examples=400, deadline=None)
@given(st.sampled_from(DECIDED + LEFT_OPEN), HEIGHTS, HEIGHTS, st.booleans(), VALUES, NUMBERS)
@example(DECIDED[0], [0.5] * 8, [0.0] * 8, False, {"limit": 0, "lasting": 2, "bridge": 1}, 0.5)
def test_a_piece_says_what_judging_says(case, a, b, truncated, values, number):
    facts = Facts({"height(a)": a, "height(b)": b}, truncated=truncated)
    piece, now = told(facts, *case, values, number)
    assert piece.verdict is None or (piece.verdict, piece.at_risk) == now


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(DECIDED), HEIGHTS, HEIGHTS, NUMBERS)
def test_what_is_known_is_decided(case, a, b, number):
    """Where nothing is unknown, no value of these is left open."""
    known = [[0.0 if isnan(x) else x for x in heights] for heights in (a, b)]
    facts = Facts({"height(a)": known[0], "height(b)": known[1]})
    piece, now = told(facts, *case, {"limit": 0.5, "lasting": 2, "bridge": 1}, number)
    assert (piece.verdict, piece.at_risk) == now


def test_a_duration_of_another_kind_is_in_no_piece():
    rules = ruleset(
        HEAD.replace("{limit}", "1").replace("{lasting}", "2").replace("{bridge}", "1")
        + 'forbid = "long(a)"'
    )
    facts = Facts({"height(a)": [0.0] * 8, "height(b)": [0.0] * 8})
    base = Evaluator(facts, rules, rules.params, None)
    line = pieces_of(base, rules.rules["TOY101"], PLAYERS, "lasting")
    usual = rules.params["lasting"]
    assert any(piece.holds(ast.Duration(3.0), usual) for piece in line)
    assert not any(piece.holds(ast.Duration(3.0, frames=True), usual) for piece in line)
    assert not any(piece.holds(ast.Duration(3.0, least=2), usual) for piece in line)
