"""Results in the formats that people and programs read. One file per format."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from safestage_eval.run.scores import Scores

    from .golden import Change

TABLE_FORMATS = ("table", "json", "csv", "markdown", "latex")
"""Formats of result tables and comparisons: those of ``layouts``, and two for programs."""

FORMATS = ("table", "json", "jsonl", "csv", "parquet", "markdown", "junit", "github")


def render(scores: Scores, form: str, changes: Sequence[Change] | None = None) -> str | bytes:
    """Results in one of ``FORMATS`` (the table without colours). Raises KeyError for another.

    ``changes``, what is not as a golden file expects, is for build servers: junit and github.
    """
    if form == "parquet":
        from . import results_parquet

        return b"".join(results_parquet.pieces(scores))
    from . import ci_report, results_csv, results_json, results_markdown, results_text

    if form == "junit":
        return ci_report.render_junit(scores, changes)
    if form == "github":
        return ci_report.render_github(scores, changes)
    return {
        "table": results_text.render,
        "json": lambda found: "".join(results_json.pieces(found)),
        "jsonl": lambda found: "".join(results_json.lines(found)),
        "csv": lambda found: "".join(results_csv.pieces(found)),
        "markdown": results_markdown.render,
    }[form](scores)


def pieces(
    scores: Scores, form: str, changes: Sequence[Change] | None = None
) -> Iterator[str | bytes]:
    """Results piece by piece, so that few rows are held at a time."""
    from . import results_csv, results_json, results_parquet

    streamed: dict[str, Callable[[Scores], Iterator[str] | Iterator[bytes]]] = {
        "json": results_json.pieces,
        "jsonl": results_json.lines,
        "csv": results_csv.pieces,
        "parquet": results_parquet.pieces,
    }
    if form in streamed:
        yield from streamed[form](scores)
    else:
        yield render(scores, form, changes)
