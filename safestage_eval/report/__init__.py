"""Results in the formats that people and programs read. One file per format."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from safestage_eval.scoring import Scores

    from .golden import Change

FORMATS = ("table", "json", "jsonl", "csv", "parquet", "markdown", "junit", "github")


def render(scores: Scores, form: str, changes: Sequence[Change] | None = None) -> str | bytes:
    """Results in one of ``FORMATS`` (the table without colours). Raises KeyError for another.

    ``changes``, what is not as a golden file expects, is for build servers: junit and github.
    """
    if form == "parquet":
        from . import as_parquet

        return as_parquet.render(scores)
    from . import as_ci, as_csv, as_json, as_markdown, as_table

    if form == "junit":
        return as_ci.render_junit(scores, changes)
    if form == "github":
        return as_ci.render_github(scores, changes)
    return {
        "table": as_table.render,
        "json": as_json.render,
        "jsonl": as_json.render_lines,
        "csv": as_csv.render,
        "markdown": as_markdown.render,
    }[form](scores)
