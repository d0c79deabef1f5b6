"""Other benchmarks' questions: loaded by name only, side by side with ours, and told as they are."""

import re
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft7Validator

from safestage_eval.errors import RuleError
from safestage_eval.rules import (
    benchmark_names,
    builtin_names,
    check_rules,
    load_rules,
    rule_digest,
)
from safestage_eval.rules.files import BENCHMARKS, builtin_folder
from safestage_eval.rules.schema import schema

PAGE = (Path(__file__).parents[2] / "docs" / "other_benchmarks.md").read_text("utf-8")
LETTERS = {
    "is_bench": "ISB",
    "iso_ts_15066": "ISO",
    "libero_safety": "LBS",
    "maniguard": "MGD",
    "oopsieverse": "OOP",
    "robolab": "RLB",
    "safelibero": "SLB",
    "safemanip": "SMP",
    "safevla": "SVL",
    "safety_gymnasium": "SGY",
    "safevla_bench": "SVB",
}
each = pytest.mark.parametrize("name", benchmark_names())


def source(name: str) -> str:
    return (builtin_folder() / BENCHMARKS / f"{name}.toml").read_text("utf-8")


def section(name: str) -> str:
    """Section of the page about one file."""
    parts = re.split(r"^## ", PAGE, flags=re.MULTILINE)
    (found,) = [part for part in parts if f"(`{name}`)" in part.splitlines()[0]]
    return found


@each
def test_it_is_sound_alone(name: str) -> None:
    assert check_rules([name]) == []
    assert load_rules([name]).name == name.replace("_", "-")


@each
def test_the_schema_accepts_it(name: str) -> None:
    assert Draft7Validator(schema()).is_valid(tomllib.loads(source(name)))


@each
def test_its_codes_say_whose_they_are(name: str) -> None:
    rules = load_rules([name])
    assert {code[:3] for code in (*rules.rules, *rules.costs)} == {LETTERS[name]}
    assert all(rule.explain and rule.why for rule in rules.rules.values())


@each
def test_each_rule_names_its_source(name: str) -> None:
    for code, rule in load_rules([name]).scoped.items():
        code_at = r"[\w.-]+/[\w.-]+@[0-9a-f]{7,} \S+\.(py|md|txt|csv)\b"
        assert re.match(rf"({code_at}|ISO)", rule.source), code


@each
def test_every_value_says_where_it_comes_from(name: str) -> None:
    inside = ""
    for line in source(name).split("\n"):
        if line.startswith("["):
            inside = line.split("#")[0].strip()
        elif re.fullmatch(r"\[param\]", inside) and "=" in line.split("#")[0]:
            said = line.partition("#")[2]
            assert re.search(r"\[\w+\]|no published|stands for", said), line
    assert re.search(r"^# Sources: ", source(name), re.MULTILINE)


def test_limits_that_were_not_checked_against_their_standard_say_so() -> None:
    """In the file, on the page, and in every rule and every sentence of a verdict."""
    for said in (source("iso_ts_15066"), section("iso_ts_15066")):
        assert "not checked against the standard" in said.lower()
    for code, rule in load_rules(["iso_ts_15066"]).rules.items():
        assert "not checked against the standard" in rule.source, code
        assert "not checked against the standard" in rule.explain, code


def test_they_are_read_only_when_named(tmp_path: Path) -> None:
    own = set(load_rules(builtin_names()).rules)
    assert own == set(load_rules([builtin_folder()]).rules)
    assert not set(benchmark_names()) & set(builtin_names())
    for name in benchmark_names():
        assert not own & set(load_rules([name]).rules)
    assert load_rules([f"{benchmark_names()[0]}.toml"]).rules
    with pytest.raises(RuleError, match="robolab"):
        load_rules(["robolob"])
    mine = tmp_path / "mine.toml"
    mine.write_text('[ruleset]\nformat = 1\nname = "m"\nversion = "1"\nextends = ["robolab"]\n')
    assert load_rules([mine]).rules == {}


def test_all_together_change_no_rule() -> None:
    together = load_rules([*builtin_names(), *benchmark_names()])
    for names in (builtin_names(), *([name] for name in benchmark_names())):
        alone = load_rules(names)
        for code, rule in alone.rules.items():
            assert rule_digest(alone, rule, alone.params) == rule_digest(
                together, together.rules[code], together.params
            )


@each
def test_the_page_lists_its_rules(name: str) -> None:
    rules = load_rules([name])
    values = dict(re.findall(r"^\| `([A-Z]{3}\d{3})` \| ([^|]+?) \|", section(name), re.MULTILINE))
    titles = {code: rule.title for code, rule in {**rules.rules, **rules.costs}.items()}
    assert values == titles


@each
def test_the_page_says_what_is_equal_and_what_is_not(name: str) -> None:
    text = section(name)
    for word in (
        "**Equal.**",
        "**Approximated.**",
        "**A trace must carry**",
        "**Cannot be said.**",
    ):
        assert word in text, word


def test_the_page_has_no_other_sections() -> None:
    named = re.findall(r"^## .*\(`(\w+)`\)$", PAGE, re.MULTILINE)
    assert sorted(named) == benchmark_names()
