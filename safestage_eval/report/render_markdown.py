"""Tables as Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from safestage_eval._text.printable import printable

from .table import Table


def render_markdown(tables: Sequence[Table], notes: Sequence[str] = (), lead: str = "") -> str:
    """The lead, a section for each table, then one with the notes as a list."""
    lines = [f"**{markdown_text(lead)}**", ""] if lead else []
    for table in tables:
        lines += [f"## {markdown_text(table.title)}", ""] if table.title else []
        lines += [*markdown_lines(table), ""]
    if notes:
        lines += ["## Notes", "", *markdown_list(notes)]
    return "\n".join(lines).rstrip("\n") + "\n"


def markdown_lines(table: Table) -> list[str]:
    """A pipe table without its title."""
    marks = ["---" if table.is_left(i) else "---:" for i in range(table.width)]
    return [_piped(table.columns), f"|{'|'.join(marks)}|", *map(_piped, table.rows)]


def markdown_list(texts: Iterable[str]) -> list[str]:
    """A bullet for each text."""
    return [f"- {markdown_text(text)}" for text in texts]


def markdown_text(text: str) -> str:
    """One line of a paragraph, shown as it is: it begins no tag of HTML, entity, link or picture."""
    plain = printable(" ".join(text.split())).replace("\\", "\\\\")
    plain = re.sub(r"^\[|\](?=[(\[])", r"\\\g<0>", plain)
    plain = re.sub(r"&(?=#?\w+;)", "&amp;", plain)
    return re.sub(r"<(?=[A-Za-z/!?])", "&lt;", plain)


def markdown_code(text: str) -> str:
    """A name in backticks."""
    return f"`{printable(text).replace('`', 'ˋ')}`"


def _piped(cells: Sequence[str]) -> str:
    shown = (markdown_text(cell).replace("|", "\\|") for cell in cells)
    return f"| {' | '.join(shown)} |"
