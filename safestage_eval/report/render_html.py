"""Tables as HTML, for the pages of a run."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from .table import Table


def render_html(tables: Sequence[Table], notes: Sequence[str] = ()) -> str:
    """A scrolling ``table.results`` for each, with its title as caption, then the notes as a list."""
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    listed = f'<ul class="small">{items}</ul>' if items else ""
    return "".join(map(_table, tables)) + listed


def _table(table: Table) -> str:
    def cell(kind: str, column: int, text: str, scope: str = "") -> str:
        amount = "" if table.is_left(column) else ' class="amount"'
        return f"<{kind}{scope}{amount}>{escape(text)}</{kind}>"

    head = "".join(cell("th", i, text, ' scope="col"') for i, text in enumerate(table.columns))
    body = []
    for row in table.shown_rows():
        group = ' class="group"' if row[0] else ""
        names = "".join(
            cell("th", i, text, ' scope="row"') for i, text in enumerate(row[: table.names])
        )
        values = "".join(cell("td", i, text) for i, text in enumerate(row[table.names :], table.names))  # fmt: skip
        body.append(f"<tr{group}>{names}{values}</tr>")
    title = escape(table.title)
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{title}"><table class="results">'
        f"<caption>{title}</caption><thead><tr>{head}</tr></thead>"
        f"<tbody>{''.join(body)}</tbody></table></div>"
    )
