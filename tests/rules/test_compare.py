"""Differences between two rule sets, and rules that are partly one, partly the other."""

import pytest
from toy import ruleset

from safestage_eval.rules import rule_digest
from safestage_eval.rules.compare import Meaning, compare, differences, mixed
from safestage_eval.rules.uses import own_params

BASE = """
[ruleset]
format = 1
name = "mine"
version = "1"
[param]
near = "8 cm"
idle = "1 s"
[material.default]
lean = "10 deg"
[state.up]
of = ["a"]
when = { "lift(a)" = ">= near" }
[phase.late]
span = "last idle of episode"
[[rule]]
code = "ETS901"
title = "one"
roles = { target = "object", other = "object" }
during = "late"
require = { "clearance(target, other)" = ">= near", "tilt(target)" = "<= lean(target)" }
forbid = ["up(other)"]
[[rule]]
code = "ETS902"
title = "two"
roles = { target = "object" }
require = { "speed(target)" = "<= 1 m/s" }
"""

CHANGES = [
    ('near = "8 cm"', 'near = "10 cm"', "near: 8 cm → 10 cm"),
    ('lean = "10 deg"', 'lean = "12 deg"', "material default.lean: 10 deg → 12 deg"),
    ('">= near" }\n[phase', '"> near" }\n[phase', "state up: lift(a) at least"),
    ('span = "last idle', 'span = "first idle', "phase late: the last"),
    ('>= near", "tilt', '> near", "tilt', "always clearance(target, other): at least"),
    (', "tilt(target)" = "<= lean(target)"', "", "always tilt(target) left out"),
    ('["up(other)"]', '["up(other)", "up(target)"]', "never up(target) added"),
    ('during = "late"\n', "", "judged during : late → None"),
    ('other = "object" }\nduring', 'other = "surface" }\nduring', "roles : "),
]


def meaning(text, code="ETS901"):
    rules = ruleset(text)
    return Meaning(rules, rules.rules[code], own_params(rules, rules.rules[code]))


def digest(side):
    return rule_digest(side.rules, side.rule, side.params)


@pytest.mark.parametrize(("old", "new", "said"), CHANGES)
def test_each_change_is_one_part_of_one_rule(old, new, said):
    assert old in BASE
    before, after = meaning(BASE), meaning(BASE.replace(old, new))
    parts = differences(before, after)
    (part,) = [p for p in parts if not (p.kind == "material" and "tilt" in said)]
    assert said.split(":")[0].strip() in str(part) or part.label in said
    found = compare(before.rules, after.rules)
    assert list(found.changed) == ["ETS901"]
    assert found.same == ("ETS902",)


@pytest.mark.parametrize(("old", "new", "said"), CHANGES)
@pytest.mark.parametrize(("other", "others", "_"), CHANGES[:2])
def test_all_parts_make_the_rule_afterwards_and_none_the_rule_before(
    old, new, said, other, others, _
):
    before = meaning(BASE)
    after = meaning(BASE.replace(old, new).replace(other, others))
    parts = differences(before, after)
    assert digest(mixed(before, after, [])) == digest(before)
    assert digest(mixed(before, after, parts)) == digest(after)
