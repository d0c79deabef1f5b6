"""The editor's schema: up to date, accepts what checks clean, rejects what no names could mend."""

import json
import tomllib
from pathlib import Path

import pytest
from jsonschema import Draft7Validator
from test_diagnostic import CASES, unmark

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


def test_every_key_has_a_description_for_the_editor() -> None:
    keys = schema()["properties"]["rule"]["items"]["properties"]
    assert all(key["description"] for key in keys.values())
