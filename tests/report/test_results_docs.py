"""docs/results.md describes what is there, and nothing else."""

import re
from pathlib import Path

import polars as pl
import pytest
from fabricated import scores

from safestage_eval.report import FORMATS
from safestage_eval.report.result_rows import COLUMNS, document
from safestage_eval.report.results_parquet import SCHEMA
from safestage_eval.units import DIMENSIONS, unit_of

TEXT = (Path(__file__).parents[2] / "docs" / "results.md").read_text("utf-8")


def section(title):
    return TEXT.split(f"\n## {title}\n")[1].split("\n## ")[0]


def first_cells(text):
    """Names in the first column of the tables of a text."""
    return [
        name
        for line in text.splitlines()
        if line.startswith("| `")
        for name in re.findall(r"`([^`]+)`", line.split("|")[1])
    ]


def test_every_column_once():
    found = first_cells(section("Result rows"))
    assert sorted(found) == sorted(COLUMNS)


@pytest.mark.parametrize("name", COLUMNS)
def test_types_are_those_of_the_parquet_file(name):
    line = next(li for li in section("Result rows").splitlines() if li.startswith(f"| `{name}` |"))
    said = line.split("|")[2].strip().split(",")[0].split(" of ")[0]
    words = {"string": "text", "int64": "integer", "bool": "boolean", "double": "number"}
    kind = str(SCHEMA.field(name).type)
    assert said == words.get(kind, "list")


def test_every_format():
    assert first_cells(TEXT.split("\n## ")[0]) == ["--format", *FORMATS]


def test_the_json_object():
    block = re.search(r"```\n(\{.*?\n\})\n```", TEXT, re.DOTALL)[1]
    assert re.findall(r'^  "(\w+)":', block, re.MULTILINE) == list(document(scores()))


def test_every_metric_and_its_fields():
    found = document(scores())["metrics"]
    section_text = section("Metrics")
    assert all(f"`{name}`" in section_text for row in found.pop("by_rule") for name in row)
    assert all(f"`{name}`" in section_text for name in found.pop("headline"))
    assert all(f"`{row['metric']}`" in section_text for table in found.values() for row in table)
    fields = {name for table in found.values() for row in table for name in row}
    assert fields <= set(first_cells(section_text.split("`metrics` holds")[1]))
    assert all(f"`{name}`" in section_text for name in found)


def test_every_unit():
    line = next(li for li in section("Result rows").splitlines() if li.startswith("| `unit` |"))
    section_text = set(re.findall(r"`([^`]+)`", line.partition("margin`")[2]))
    assert section_text == {unit_of(dimension) for dimension in DIMENSIONS} - {""}


def test_empty_cells_are_null():
    """CSV is read as the document says; polars agrees."""
    from safestage_eval.report import render

    frame = pl.read_csv(render(scores(), "csv").encode())
    assert frame["time"].null_count() == sum(
        row["time"] is None for row in document(scores())["episodes"]
    )
