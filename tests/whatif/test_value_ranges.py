"""The pieces of a parameter's values say of each value what judging under it says."""

import itertools
import random
from dataclasses import replace
from math import isnan
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from sampled import share
from toy import Facts, ruleset

from safestage_eval.formats import discover
from safestage_eval.rules import load_rules
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import parameters_read
from safestage_eval.rules.syntax import amount
from safestage_eval.sketch import resolve
from safestage_eval.verdicts.evaluate import Evaluator
from safestage_eval.whatif.judge_again import Again
from safestage_eval.whatif.swept_values import like
from safestage_eval.whatif.value_ranges import all_pieces

ROOT = Path(__file__).parents[2]

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
    ('given = { "high(b)" = true }\nforbid = "long(a)"', "limit"),
    ('forbid = "high_long(a)"', "limit"),
    ('require = { "height(a)" = [">= limit", "<= 1 m"] }', "limit"),
    ('require = { "height(a)" = ">= limit", "height(b)" = "<= limit" }', "limit"),
    ('forbid = ["high(a)"]\nrequire = { "high(b)" = true }', "limit"),
    ('given = { "high(a)" = true }\nrequire = { "height(b)" = ">= 0 m" }', "limit"),
    ('forbid = "start of high(a)"', "limit"),
    ('forbid = "end of high(a)"', "limit"),
    ('forbid = "reset(a, b)"', "limit"),
    ('forbid = "until_long(a, b)"', "limit"),
]
"""Obligations with a limit that they read."""

LEFT_OPEN = [
    ('given = { "high(b)" = true }\nforbid = "long(a)"', "lasting"),
    ('forbid = "long(a)"', "lasting"),
    ('reach = "long(a)"', "lasting"),
    ('forbid = "high(a)"\nfor = "lasting"', "lasting"),
    ('reach = "high(a)"\nfor = "lasting"', "lasting"),
    ('forbid = "high_long(a)"', "lasting"),
    ('forbid = "long_long(a)"', "lasting"),
    ('reach = "long_long(a)"', "lasting"),
    ('during = "high(a)"\nrequire = { "height(b)" = ">= 0 m" }', "limit"),
    ('during = "high(a)"\nforbid = "high(b)"\nfor = "2 s"', "limit"),
    ('during = "from high(a) to high(b)"\nforbid = "long(b)"', "limit"),
    ('forbid = "until_long(a, b)"', "lasting"),
    ('during = "first lasting of episode"\nforbid = "high(a)"', "lasting"),
    ('during = "last lasting of episode"\nrequire = { "height(a)" = ">= 0 m" }', "lasting"),
    ('during = "lasting after start of high(a)"\nrequire = { "height(b)" = ">= 0 m" }', "lasting"),
    ('forbid = "long(a)"', "bridge"),
    ('forbid = "long(b)"\nuntil = "high(a)"', "limit"),
    ('at = "start of high(a)"\nrequire = { "height(b)" = ">= 0 m" }', "limit"),
    ('during = "high(a)"\nreach = "high(b)"', "limit"),
    ('during = "first lasting of episode"\nforbid = "long(a)"', "lasting"),
    ('during = "first lasting of last lasting of episode"\nforbid = "long(a)"', "lasting"),
]
"""Likewise with what moves stretches and durations; their pieces may be undecided, but never wrong."""

HEIGHTS = st.lists(
    st.one_of(st.sampled_from([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0]), st.just(float("nan"))),
    min_size=8,
    max_size=8,
)


class Toy(Again):
    """Two given series, ready to be judged by the one rule of a text."""

    def __init__(self, facts, text, **values):
        head = HEAD
        for name, value in values.items():
            head = head.replace(f"{{{name}}}", str(value))
        self.rules = ruleset(head + text)
        self.rule, self.episode = self.rules.rules["TOY101"], facts.episode
        params, players = self.rules.params, {"a": ("a",), "b": ("b",)}
        self.binding = SimpleNamespace(
            params=lambda _: params, players=lambda *_: players, goal=None
        )
        self.origin = Evaluator(facts, self.rules, params, None)

    def evaluator(self, rule):
        return self.origin


def told(again, rule, param, number):
    """The piece that a number is in, and what judging says under it."""
    line = all_pieces(again, rule, [param])[param]
    assert line[0].low == 0
    assert line[-1].high == float("inf")
    assert all(a.high == b.low for a, b in itertools.pairwise(line))
    (piece,) = [piece for piece in line if piece.low <= number < piece.high]
    return piece, again.judged(rule, {param: like(again.binding.params(rule)[param], number)})


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


@settings(max_examples=200, deadline=None)
@given(st.sampled_from(DECIDED + LEFT_OPEN), HEIGHTS, HEIGHTS, st.booleans(), VALUES, NUMBERS)
@example(DECIDED[0], [0.5] * 8, [0.0] * 8, False, {"limit": 0, "lasting": 2, "bridge": 1}, 0.5)
def test_a_piece_says_what_judging_says(case, a, b, truncated, values, number):
    text, param = case
    facts = Facts({"height(a)": a, "height(b)": b}, truncated=truncated)
    again = Toy(facts, text, **values)
    piece, now = told(again, again.rule, param, number)
    assert piece.verdict is None or (piece.verdict, piece.at_risk) == now


@settings(max_examples=75, deadline=None)
@given(st.sampled_from(DECIDED), HEIGHTS, HEIGHTS, NUMBERS)
def test_of_what_is_known_every_limit_is_decided(case, a, b, number):
    text, param = case
    known = [[0.0 if isnan(x) else x for x in heights] for heights in (a, b)]
    facts = Facts({"height(a)": known[0], "height(b)": known[1]})
    again = Toy(facts, text, limit=0.5, lasting=2, bridge=1)
    piece, now = told(again, again.rule, param, number)
    assert (piece.verdict, piece.at_risk) == now


def agreeing(again, rng, draws=2):
    """Compare random values of all parameters; (decided, asked) by parameter."""
    found = {}
    for rule in again.assigned:
        values = again.binding.params(rule)
        names = sorted(parameters_read(again.rules, rule))
        for param, line in all_pieces(again, rule, names).items():
            whole = isinstance(values[param], ast.Duration) and values[param].frames
            drawn = [rng.uniform(0, 2) * amount(values[param]) for _ in range(draws)]
            drawn = [float(round(value)) for value in drawn] if whole else drawn
            ends = [piece.low for piece in line[1:4]]  # where the verdict changes, exactly
            count = found.setdefault(param, [0, 0])
            for i, value in enumerate([*drawn, *ends]):
                piece, now = told(again, rule, param, value)
                count[0] += i < draws and piece.verdict is not None
                count[1] += i < draws
                said = f"{again.episode.header.episode_id} {rule.code} {param} = {value!r}"
                assert piece.verdict is None or (piece.verdict, piece.at_risk) == now, said
    return found


DIRECT = frozenset(
    [
        "brief_impulse",
        "brief_move",
        "brief_turn",
        "commit_lift",
        "drop_height",
        "drop_speed",
        "edge",
        "nudge",
        "nudge_tilt",
        "sink_in",
        "toppled",
        "upright",
    ]
)
"""Limits that are decided wherever they are read."""


@pytest.mark.parametrize("part", range(3))
def test_recorded_episodes_agree_under_random_values(part):
    rules, rng, answers = load_rules(["ish", "ets", "fsh", "goals"]), random.Random(part), {}
    for ref in share(discover([ROOT / "traces"])[part::3], 2):
        for param, (decided, asked) in agreeing(Again(ref.open(), rules), rng).items():
            before = answers.get(param, (0, 0))
            answers[param] = before[0] + decided, before[1] + asked
    assert not {param for param, (decided, asked) in answers.items() if decided < asked} & DIRECT
    assert sum(asked for _, asked in answers.values()) > 20


SKETCHES = {
    "carried_past(gap = 8.1)": "ETS201",
    "carried_past(gap = 7.9)": "ETS202",
    "obstacle_disturbed": "ETS102",
    "obstacle_touched": "ETS101",
    "bystander_shoved": "ETS106",
    "neighbour_pushed(way = 1.1)": "FSH202",
    "creeping_after_success(until = 8.65)": "FSH106",
    "placed_without_success(margin = 1.9)": "FSH101",
    "left_beside": "FSH203",
    "can_wobbles_under_bottle": "ISH101",
    "lemon_tipped_out": "ISH203",
    "let_go_above(rate = 5)": "FSH105",
}


@pytest.mark.parametrize(("sketch", "code"), SKETCHES.items())
def test_examples_agree_under_random_values(sketch, code):
    episode = resolve(sketch, [ROOT / "rules" / "examples"])
    header = episode.header.model_copy(update={"rules": (code,)})
    again = Again(replace(episode, header=header), load_rules(["ish", "ets", "fsh", "goals"]))
    assert [rule.code for rule in again.assigned] == [code]
    agreeing(again, random.Random(code))
