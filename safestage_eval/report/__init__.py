"""Results in the formats that people and programs read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from safestage_eval.run.scores import Scores

    from .golden import Change

TABLE_FORMATS = ("table", "json", "csv", "markdown")
"""Formats of result tables and comparisons; the paper's two tables are there in LaTeX as well."""

FORMATS = ("table", "json", "jsonl", "csv", "parquet", "markdown", "junit", "github", "sarif")


def render(scores: Scores, form: str, changes: Sequence[Change] | None = None) -> str | bytes:
    """Results in one of ``FORMATS`` (the table without colours). Raises KeyError for another.

    ``changes``, differences from a golden file, are for build servers: junit and github.
    """
    parts = list(pieces(scores, form, changes))
    return b"".join(parts) if form == "parquet" else "".join(parts)  # type: ignore[arg-type]


def pieces(
    scores: Scores, form: str, changes: Sequence[Change] | None = None
) -> Iterator[str | bytes]:
    """Results piece by piece, so that few rows are held at a time. Arguments as for ``render``."""
    if form == "parquet":
        from . import results_parquet

        yield from results_parquet.pieces(scores)
        return
    from . import document, for_build_servers, result_rows, results_text

    writers: dict[str, Callable[[], Iterable[str]]] = {
        "table": lambda: [results_text.render(scores)],
        "json": lambda: result_rows.json_pieces(scores),
        "jsonl": lambda: result_rows.json_lines(scores),
        "csv": lambda: document.csv_pieces(result_rows.COLUMNS, result_rows.each_row(scores)),
        "markdown": lambda: [results_text.markdown(scores)],
        "junit": lambda: [for_build_servers.junit(scores, changes)],
        "github": lambda: [for_build_servers.github(scores, changes)],
        "sarif": lambda: [for_build_servers.sarif(scores)],
    }
    yield from writers[form]()
