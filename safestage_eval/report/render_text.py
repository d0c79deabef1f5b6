"""Tables as plain text for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.cells import cell_len

from safestage_eval._text.printable import printable

from .table import Table

GAP = "  "


def render_text(tables: Sequence[Table], notes: Sequence[str] = (), lead: str = "") -> str:
    """The lead, each table and an empty line, then the notes."""
    lines = [printable(lead), ""] if lead else []
    for table in tables:
        lines += [*text_lines(table), ""]
    return "\n".join([*lines, *map(printable, notes)]).rstrip("\n") + "\n"


def text_lines(table: Table) -> list[str]:
    """Title, heads and rows, columns under each other; never wrapped."""
    cells = [[printable(cell) for cell in row] for row in (table.columns, *table.shown_rows())]
    cells = [row for row in cells if row]
    sizes = [max(cell_len(row[i]) for row in cells) for i in range(table.width)] if cells else []
    lines = [
        GAP.join(_aligned(cell, sizes[i], table.is_left(i)) for i, cell in enumerate(row)).rstrip()
        for row in cells
    ]
    if table.title:
        rule = ["─" * (sum(sizes) + len(GAP) * (len(sizes) - 1))] if table.columns else []
        lines = [printable(table.title), *lines[: len(rule)], *rule, *lines[len(rule) :]]
    return lines


def _aligned(text: str, size: int, left: bool) -> str:
    space = " " * (size - cell_len(text))
    return text + space if left else space + text
