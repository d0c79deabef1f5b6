"""Other benchmarks' questions: loaded by name only, side by side with ours, and told as they are."""

import re
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft7Validator

from safestage_eval.rules import (
    benchmark_names,
    check_rules,
    load_rules,
)
from safestage_eval.rules.files import BENCHMARKS, builtin_folder
from safestage_eval.rules.schema import schema

PAGE = (Path(__file__).parents[2] / "docs" / "other_benchmarks.md").read_text("utf-8")
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
