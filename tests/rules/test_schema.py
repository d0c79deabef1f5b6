"""The editor's schema: up to date, accepts what checks clean, rejects what no names could mend."""

import json
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft7Validator
from test_diagnostic import CASES, GOOD, rule, unmark

from safestage_eval.rules.files import builtin_folder
from safestage_eval.rules.schema import FILE, schema, schema_text

VALIDATOR = Draft7Validator(schema())
BY_NAMES_ONLY = {"R104", "R106", "R209", "R210", "R211", "R401", "R402", "R403", "R404", "R408", "R409", "R410", "R411", "R412", "R413", "R415"}  # fmt: skip
"""Problems that need the other definitions; the schema sees some of them all the same."""


def accepts(text: str) -> bool:
    return bool(VALIDATOR.is_valid(tomllib.loads(text)))


def test_the_committed_file_is_up_to_date() -> None:
    committed = Path(__file__).parents[2] / "schemas" / FILE
    assert committed.read_text("utf-8") == schema_text(), (
        "run: python -m safestage_eval.rules.schema"
    )
    assert json.loads(schema_text()) == json.loads(json.dumps(schema()).replace("\\\\ ", " "))


def test_it_is_a_schema() -> None:
    Draft7Validator.check_schema(schema())


@pytest.mark.parametrize("path", sorted(builtin_folder().glob("*.toml")), ids=lambda p: p.stem)
def test_builtin_files_are_accepted(path: Path) -> None:
    assert accepts(path.read_text("utf-8"))


@pytest.mark.parametrize(
    "case", [c for c in CASES if c[0] not in BY_NAMES_ONLY | {"R102"}], ids=lambda c: c[0]
)
def test_what_the_grammar_refuses_is_rejected(case: tuple[str, ...]) -> None:
    text = unmark(case[1])[0]
    if case[0] == "R407" and not any(op in text for op in ("deg", '">= 5"')):
        return  # a parameter's dimension is for the checker
    if any(part in text for part in ('"0 cm"]]', "damage_threshold", "heat(a)")):
        return  # so are the size of a box, a variant's and a column's dimension
    if any(
        part in text for part in ("last 1 s of episode", 'at least 2 a"', "<= 5 N", "[2 s, 1 s]")
    ):
        return  # so are where a span or a count may stand, and what a declared name is
    assert not accepts(text)


def test_what_it_accepts_and_rejects_by_hand() -> None:
    assert accepts(rule(GOOD))
    assert accepts(rule('require = { "my_state(a)" = true, "my_signal(a, b)" = "<= 3" }\n'))
    assert accepts(rule('require = { "edge_margin(a)" = ">= 2 cm" }\n'))
    assert accepts(rule('require = { "edge_margin(a, b)" = ">= 2 cm" }\n'))
    assert not accepts(rule('require = { "edge_margin(a, b, c)" = ">= 2 cm" }\n'))
    assert not accepts(rule('require = { "clearance(a)" = ">= 2 cm" }\n'))
    assert not accepts(rule('require = { "inside(a, b)" = ">= 2 cm" }\n'))
    assert not accepts("")


SIGNALS_AND_STATES = """
[ruleset]
format = 1
name = "s"
version = "1"
[signal.one]
of = ["a"]
{signal}
[state.two]
of = ["a"]
when = {{ {state} }}
"""


@pytest.mark.parametrize(
    ("signal", "state", "good"),
    [
        ('sum = ["speed(a)", "2 cm/s"]', '"once[0 s, 2 s] p(a)" = true', True),
        ('derivative = "speed(a)"', '"always p(a)" = false', True),
        ('product = [2, "speed(a) since start of held(a)"]', '"p(a) since[0 s] q(a)" = true', True),
        ('max = ["speed(a)", "-limit"]', '"p(a) iff q(a)" = true', True),
        ('sum = ["speed(a)", "2 cm/s"]', '"once[0 s, 2 s] p(a)" = ">= 2 cm"', False),
        ('sum = ["speed(a)", "2 cm/s"]', '"once[0 s; 2 s] p(a)" = true', False),
        ('sum = ["speed(a)"]\nabs = "speed(a)"', '"p(a)" = true', False),
        ('total = ["speed(a)"]', '"p(a)" = true', False),
        ("abs = true", '"p(a)" = true', False),
    ],
)
def test_computed_signals_and_states_as_they_were(signal: str, state: str, good: bool) -> None:
    assert accepts(SIGNALS_AND_STATES.format(signal=signal, state=state)) == good


def test_every_key_has_a_description_for_the_editor() -> None:
    keys = schema()["properties"]["rule"]["items"]["properties"]
    assert all(key["description"] for key in keys.values())
