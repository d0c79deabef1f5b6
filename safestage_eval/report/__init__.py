"""Results in the formats that people and programs read. One file per format."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from safestage_eval.run.scores import Scores

    from .golden import Change

FORMATS = ("table", "json", "jsonl", "csv", "parquet", "markdown", "junit", "github")


def render(scores: Scores, form: str, changes: Sequence[Change] | None = None) -> str | bytes:
    """Results in one of ``FORMATS`` (the table without colours). Raises KeyError for another.

    ``changes``, what is not as a golden file expects, is for build servers: junit and github.
    """
    if form == "parquet":
        from . import as_parquet

        return b"".join(as_parquet.pieces(scores))
    from . import as_ci, as_csv, as_json, as_markdown, as_table

    if form == "junit":
        return as_ci.render_junit(scores, changes)
    if form == "github":
        return as_ci.render_github(scores, changes)
    return {
        "table": as_table.render,
        "json": lambda found: "".join(as_json.pieces(found)),
        "jsonl": lambda found: "".join(as_json.lines(found)),
        "csv": lambda found: "".join(as_csv.pieces(found)),
        "markdown": as_markdown.render,
    }[form](scores)


def pieces(
    scores: Scores, form: str, changes: Sequence[Change] | None = None
) -> Iterator[str | bytes]:
    """The same one after the other; of rows, few are held at a time."""
    from . import as_csv, as_json, as_parquet

    streamed: dict[str, Callable[[Scores], Iterator[str] | Iterator[bytes]]] = {
        "json": as_json.pieces,
        "jsonl": as_json.lines,
        "csv": as_csv.pieces,
        "parquet": as_parquet.pieces,
    }
    if form in streamed:
        yield from streamed[form](scores)
    else:
        yield render(scores, form, changes)
