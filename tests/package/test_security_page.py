"""docs/security.md: every sentence about a stranger names a test that is there."""

import ast
import re
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[2]
TEXT = (CHECKOUT / "docs" / "security.md").read_text("utf-8")
OURS = TEXT.split("## What was tried")[0]
NAMED = sorted(set(re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", OURS)))
LISTENERS = ("label", "view", "serve")


def rows(heading):
    """Cells of the table below a heading."""
    section = OURS.split(f"\n{heading}\n", 1)[1].split("\n#", 1)[0]
    lines = [line for line in section.split("\n") if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


@pytest.mark.parametrize(("file", "name"), NAMED, ids=lambda part: str(part) or "-")
def test_the_test_is_there(file, name):
    tree = ast.parse((CHECKOUT / file).read_text("utf-8"))
    assert not name or name in {
        node.name for node in tree.body if isinstance(node, ast.FunctionDef)
    }


@pytest.mark.parametrize("heading", ["## Files", "## Listeners"])
def test_every_row_says_what_can_be_done_and_what_not_and_names_its_test(heading):
    table = rows(heading)
    assert len(table) > 5
    for row in table:
        assert len(row) == len(table[0])
        assert re.search(r"`tests/", row[-1]), row[0]


def test_every_format_and_every_listener_has_its_row():
    files = " ".join(row[0] for row in rows("## Files"))
    for kind in ("Parquet", "MCAP", "ZIP", "rule", "bind", "map", "HDF5", "MuJoCo", "results"):
        assert kind in files
    listeners = " ".join(row[0] for row in rows("## Listeners"))
    assert all(f"`{name}`" in listeners for name in LISTENERS)


@pytest.mark.parametrize(
    "refuted",
    ["tells which data were judged", "Take all memory with few bytes", "same verdict"],
)
def test_what_was_refuted_is_said_no_more(refuted):
    pages = OURS + (CHECKOUT / "docs" / "results.md").read_text("utf-8")
    assert refuted not in pages
