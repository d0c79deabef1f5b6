"""The built-in rules on their own examples."""

import pytest
from readable import assert_readable
from sampled import share

from safestage_eval.episode.invariants import check
from safestage_eval.rules import load_rules
from safestage_eval.rules.files import builtin_folder
from safestage_eval.whatif.examples import Expected, Library, examples_of, outcome
from safestage_eval.whatif.mistakes import KINDS
from safestage_eval.whatif.mutants import definitions, hunt

RULES = load_rules(["ish", "ets", "fsh"])
EXAMPLES = [
    (rule.code, name, expected)
    for rule in RULES.rules.values()
    for name, expected in examples_of(rule)
]

LIBRARY = Library()
"""Each example is drawn and measured once, for all tests here."""


@pytest.mark.parametrize("code", RULES.rules)
def test_every_rule_has_two_examples_of_each_kind(code: str) -> None:
    rule = RULES.rules[code]
    assert min(len(set(rule.violates)), len(set(rule.passes))) >= 2
    assert rule.why
    assert rule.explain


@pytest.mark.parametrize(("code", "name", "expected"), EXAMPLES)
def test_every_example_gets_its_verdict(code: str, name: str, expected: Expected) -> None:
    verdict = LIBRARY.judge(name, RULES, RULES.rules[code])
    assert outcome(verdict, expected) == expected
    assert_readable(verdict)


@pytest.mark.parametrize(("name", "code"), {name: code for code, name, _ in EXAMPLES}.items())
def test_every_example_is_a_sound_episode(name: str, code: str) -> None:
    episode = LIBRARY.episode(name, RULES.rules[code])
    assert check(episode) == []
    assert episode.header.instruction


def test_every_example_is_used() -> None:
    there = {path.stem for path in (builtin_folder() / "examples").glob("*.toml")}
    assert there == {name.partition("(")[0] for _, name, _ in EXAMPLES}


def some_kinds(name: str) -> list[str]:
    """Two kinds of mistakes or three; ``make thorough`` makes all of them in all rules."""
    return share(KINDS, 3, of=name)


EQUIVALENT = {
    # what is in transit was touched by the robot, or by what it moved, and hands that on
    "ETS107": ["caused(bystander) → caused(protected)"],
    # what stands by itself stops doing so before it can fall 5 cm or topple by 30°
    "ISH105": ["stop resolved(target, dependent) → the end of resolved(target, dependent)"],
}
"""Rule → mistakes in it that change no verdict, whatever the episode."""


@pytest.mark.slow
@pytest.mark.parametrize("code", share(RULES.rules, 8))
def test_the_examples_notice_every_mistake(code: str) -> None:
    """A limit turned round or ten times off, a role exchanged, an obligation dropped, …"""
    found = hunt([RULES], code, LIBRARY, kinds=some_kinds(code))
    survived = {mutant.what for mutant in found if mutant.killer is None}
    assert survived <= {*EQUIVALENT.get(code, [])}


@pytest.mark.slow
@pytest.mark.parametrize("name", share(definitions(RULES), 8))
def test_some_example_notices_every_mistake_in_what_rules_rest_on(name: str) -> None:
    found = hunt([RULES], name, LIBRARY, kinds=some_kinds(name))
    assert [mutant.what for mutant in found if mutant.killer is None] == []


@pytest.mark.parametrize(
    ("gap", "level"), [("4.1", None), ("3.9", "serious"), ("1.1", "serious"), ("0.9", "critical")]
)
def test_the_worst_level_that_is_violated_too_is_named(gap: str, level: str | None) -> None:
    verdict = LIBRARY.judge(f"carried_past(gap = {gap})", RULES, RULES.rules["ETS201"])
    assert (verdict.verdict, verdict.severity) == ("violation", level)
