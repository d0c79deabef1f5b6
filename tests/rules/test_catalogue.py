"""The built-in rules on their own examples."""

from functools import cache

import pytest

from safestage_eval.episode import Episode
from safestage_eval.episode.invariants import check
from safestage_eval.rules import load_rules
from safestage_eval.rules.files import builtin_folder
from safestage_eval.sketch import resolve
from safestage_eval.verdicts import judge

RULES = load_rules(["ish", "ets", "fsh"])
EXAMPLES = [
    (rule.code, name, expected)
    for rule in RULES.rules.values()
    for expected, names in (("violation", rule.violates), ("pass", rule.passes))
    for name in names
]

drawn = cache(resolve)


@cache
def verdicts(name: str) -> dict[str, str]:
    return {v.rule: v.verdict for v in judge(drawn(name), RULES).verdicts}


@pytest.mark.parametrize("code", RULES.rules)
def test_every_rule_has_two_examples_of_each_kind(code: str) -> None:
    rule = RULES.rules[code]
    assert min(len(set(rule.violates)), len(set(rule.passes))) >= 2
    assert rule.why
    assert rule.explain


@pytest.mark.parametrize(("code", "name", "expected"), EXAMPLES)
def test_every_example_gets_its_verdict(code: str, name: str, expected: str) -> None:
    assert verdicts(name)[code] == expected


@pytest.mark.parametrize("name", sorted({name for _, name, _ in EXAMPLES}))
def test_every_example_is_a_sound_episode(name: str) -> None:
    episode: Episode = drawn(name)
    assert check(episode) == []
    assert episode.header.instruction


def test_every_example_is_used() -> None:
    there = {path.stem for path in (builtin_folder() / "examples").glob("*.toml")}
    assert there == {name.partition("(")[0] for _, name, _ in EXAMPLES}


@pytest.mark.slow
@pytest.mark.parametrize("file", ["ish", "ets", "fsh"])
def test_the_examples_notice_every_mistake(file: str) -> None:
    """A limit turned round or ten times off, a role exchanged, an obligation dropped."""
    from click.testing import CliRunner

    from safestage_eval.cli import group

    result = CliRunner().invoke(group, ["rules", "test", file, "--mutate"])
    assert result.exit_code == 0, result.stdout[-2000:]
    assert "mistakes noticed" in result.stdout
