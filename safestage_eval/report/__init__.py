"""Results in the formats that people and programs read. One file per format."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from safestage_eval.scoring import Scores

FORMATS = ("table", "json", "jsonl", "csv", "parquet", "markdown", "junit", "github")


def render(scores: Scores, form: str) -> str | bytes:
    """Results in one of ``FORMATS`` (the table without colours). Raises KeyError for another."""
    if form == "parquet":
        from . import as_parquet

        return as_parquet.render(scores)
    from . import as_ci, as_csv, as_json, as_markdown, as_table

    return {
        "table": as_table.render,
        "json": as_json.render,
        "jsonl": as_json.render_lines,
        "csv": as_csv.render,
        "markdown": as_markdown.render,
        "junit": as_ci.render_junit,
        "github": as_ci.render_github,
    }[form](scores)
