"""The digest of a rule changes with its meaning, and with nothing else."""

import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from safestage_eval.rules import rule_digest
from safestage_eval.rules.files import RuleFile
from safestage_eval.rules.load import merge
from safestage_eval.rules.syntax import Quantity

BASE = """
[ruleset]
format = 1
name = "test"
version = "1"
[param]
near = "8 cm"
long = "0.5 s"
far = "1 m"
[material.default]
lean = "15 deg"
other = "1 N"
[material.mug]
lean = "10 deg"
other = "2 N"
[state.slow]
of = ["a"]
when = { "speed(a)" = "<= 1 cm/s", "angular_speed(a)" = "<= 0.1 rad/s" }
for = "long"
[state.unused]
of = ["a"]
when = { "height(a)" = ">= far" }
[phase.after]
of = ["a"]
span = "last 1 s of episode while slow(a)"
[[rule]]
code = "ETS901"
title = "Keep off"
why = "because"
roles = { target = "object", other = "every object except target" }
given = { "supported(target)" = true }
during = "after(target)"
require = { "clearance(target, other)" = ">= near", "tilt(target)" = "<= lean(target)" }
forbid = ["held(other)", { "lift(other) since success" = ["> 1 cm", "< 5 cm"] }]
severity = { bad = { near = "4 cm" }, worse = { near = "1 cm" } }
explain = "{target} {value}"
[rule.examples]
passes = ["x"]
"""


def digest(text: str, **more) -> str:
    rules = merge([RuleFile("test.toml", text, tomllib.loads(text), asked=True)])
    (rule,) = rules.rules.values()
    params = {**rules.params, **more.pop("params", {})}
    return rule_digest(rules, rule, params, **more)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('near = "8 cm"', 'near = "80 mm"'),
        ('near = "8 cm"', 'near = "0.08 m"'),
        ('long = "0.5 s"', 'long = "500 ms"'),
        ('lean = "15 deg"', 'lean = "0.2617993877991494 rad"'),
        ("Keep off", "Stay away"),
        ("because", "for good reasons"),
        ('"{target} {value}"', '"something else"'),
        ('passes = ["x"]', 'violates = ["y"]'),
        ('name = "test"', 'name = "other"'),
        ('version = "1"', 'version = "2"'),
        ('far = "1 m"', 'far = "2 m"'),
        ('other = "2 N"', 'other = "3 N"'),
        ('when = { "height(a)" = ">= far" }', 'when = { "lift(a)" = ">= 3 cm" }'),
        ("# nothing", ""),
        ('">= near"', '">=  near"'.replace("  ", " ")),
        (
            '{ "clearance(target, other)" = ">= near", "tilt(target)" = "<= lean(target)" }',
            '{ "tilt(target)" = "<= lean(target)", "clearance(target,other)" = ">=near" }',
        ),
        (
            '["held(other)", { "lift(other) since success" = ["> 1 cm", "< 5 cm"] }]',
            '[{ "lift(other) since success" = ["< 5 cm", "> 1 cm"] }, "held(other)"]',
        ),
        (
            'roles = { target = "object", other = "every object except target" }',
            'roles = { other = "every object except target", target = "object" }',
        ),
        ('code = "ETS901"\ntitle = "Keep off"', 'title = "Keep off"\ncode = "ETS901"'),
    ],
)
def test_spelling_order_and_the_unrelated_do_not_count(old: str, new: str) -> None:
    assert digest(BASE) == digest(BASE.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('near = "8 cm"', 'near = "8.1 cm"'),
        ('long = "0.5 s"', 'long = "0.6 s"'),
        ('long = "0.5 s"', 'long = "5 frames"'),
        ('"<= 1 cm/s"', '"< 1 cm/s"'),
        ('"<= 1 cm/s"', '"<= 2 cm/s"'),
        ('lean = "10 deg"', 'lean = "11 deg"'),
        ('lean = "15 deg"', 'lean = "11 deg"'),
        ('">= near"', '">= far"'),
        ('">= near"', '">= -near"'),
        ("lean(target)", "lean(other)"),
        ("clearance(target, other)", "clearance_xy(target, other)"),
        ('"supported(target)" = true', '"supported(target)" = false'),
        ('"held(other)"', '"start of held(other)"'),
        (" since success", ""),
        ('"every object except target"', '"every object"'),
        ('"every object except target"', '"every object tagged hot except target"'),
        ("last 1 s of episode", "first 1 s of episode"),
        (" while slow(a)", ""),
        ('during = "after(target)"', 'during = "after(other)"'),
        ('near = "4 cm"', 'near = "5 cm"'),
        ("bad = ", "mild = "),
        ('"> 1 cm", "< 5 cm"', '"> 1 cm"'),
        ('code = "ETS901"', 'code = "ETS902"'),
        ('[material.mug]\nlean = "10 deg"', '[material.cup]\nlean = "10 deg"'),
        ('version = "1"', 'version = "1"\n[baseline]\nspan = "first 9 frames of episode"'),
    ],
)
def test_any_change_of_meaning_counts(old: str, new: str) -> None:
    assert old in BASE
    assert digest(BASE) != digest(BASE.replace(old, new, 1))


VARIANT = """
[signal.wear]
base = "health"
over = "50 ms"
[signal.unused]
base = "impact"
[material.default]
impact_sensitivity = 1
hold_sensitivity = 1
damage_threshold = "5 N"
damage_scale = 1
[material.egg]
damage_scale = 7
other = 3
[[rule]]
code = "ETS901"
title = "t"
roles = { a = "object" }
require = { "wear(a)" = ">= 90 %" }
"""


def variant(old: str = "", new: str = "") -> str:
    assert old in VARIANT
    text = BASE[: BASE.index("[param]")] + VARIANT.replace(old, new, 1)
    return digest(text.replace("[material.egg]", "other = 1\n[material.egg]"))


@pytest.mark.parametrize(
    ("old", "new"),
    [("50 ms", "0.05 s"), ('over = "50 ms"', ""), ('base = "impact"', 'base = "damage"'),
     ("other = 3", "other = 4"), ("50 ms", "6 frames @ 120 Hz")],
)  # fmt: skip
def test_a_signal_variant_by_another_spelling(old: str, new: str) -> None:
    assert variant() == variant(old, new)


@given(st.floats(0.001, 10, allow_nan=False))
def test_values_that_hold_count_wherever_they_come_from(value: float) -> None:
    """An override hashes like the same value written into the file."""
    text = f"{value:.6f} m"
    overridden = digest(BASE, params={"near": Quantity(float(f"{value:.6f}"), "length")})
    assert overridden == digest(BASE.replace('near = "8 cm"', f'near = "{text}"'))
    own = BASE.replace("explain =", f'set = {{ near = "{text}" }}\nexplain =')
    rules = merge([RuleFile("test.toml", own, tomllib.loads(own), asked=True)])
    (rule,) = rules.rules.values()
    assert rule_digest(rules, rule, {**rules.params, **dict(rule.set)}) == overridden
