"""What a report says, apart from how it is written: a lead, tables, notes; and its writing in every format."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from safestage_eval._text.csv_cell import to_cell
from safestage_eval._text.json_out import to_json
from safestage_eval._text.line_width import LINE_WIDTH, fold
from safestage_eval._text.printable import printable

from .render_text import text_lines
from .table import Table


@dataclass(frozen=True)
class Document:
    """A report in no format yet.

    Attributes:
        tables: for people.
        notes: sentences below them.
        lead: a sentence above them.
        facts: everything as plain values, for JSON.
        records: a row per line of CSV, all with the same names.
        paper: how many of the tables are written as LaTeX.
    """

    tables: Sequence[Table]
    notes: Sequence[str] = ()
    lead: str = ""
    facts: Callable[[], Any] = dict
    records: Callable[[], Sequence[Mapping[str, Any]]] = tuple
    paper: int = 0

    def render(self, form: str) -> str:
        """The text in one of the formats table, markdown, html, latex, csv, json. Raises KeyError for another."""
        writers: dict[str, Callable[[], str]] = {
            "table": lambda: render_text(self),
            "markdown": lambda: render_markdown(self),
            "html": lambda: render_html(self),
            "latex": lambda: render_latex(self),
            "csv": lambda: render_csv(self.records()),
            "json": lambda: render_json(self.facts()),
        }
        return writers[form]()


# ---- for a terminal


def render_text(document: Document) -> str:
    """The lead, each table and an empty line, then the notes; no line longer than ``LINE_WIDTH``."""
    width = LINE_WIDTH.get()
    lines = [*fold(printable(document.lead), width), ""] if document.lead else []
    for table in document.tables:
        lines += [*text_lines(table, width), ""]
    lines += [part for note in document.notes for part in fold(printable(note), width)]
    return "\n".join(lines).rstrip("\n") + "\n"


# ---- for programs


def render_json(value: Any) -> str:
    """The text, indented by one; infinite and NaN numbers, which JSON lacks, are null."""
    return to_json(_finite(value), 1) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _finite(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def render_csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """A line of heads, then one line per row."""
    return "".join(csv_pieces(rows[0] if rows else (), rows))


def csv_pieces(columns: Iterable[str], rows: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """The lines one by one; keys that are no column are left out, missing ones empty.

    Truth values are ``true`` and ``false``, lists JSON, None is empty.
    """
    buffer, names = io.StringIO(), [*columns]
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(names)
    for row in rows:
        writer.writerow([_csv_cell(row.get(name)) for name in names])
        yield buffer.getvalue()
        buffer.seek(0)
        buffer.truncate()
    yield buffer.getvalue()


def _csv_cell(value: Any) -> Any:
    if isinstance(value, str):
        return to_cell(value)
    if isinstance(value, bool):
        return str(value).lower()
    return to_json(value) if isinstance(value, list | dict) else value


# ---- Markdown


def render_markdown(document: Document) -> str:
    """The lead, a section for each table, then one with the notes as a list."""
    lines = [f"**{markdown_text(document.lead)}**", ""] if document.lead else []
    for table in document.tables:
        lines += [f"## {markdown_text(table.title)}", ""] if table.title else []
        lines += [*markdown_lines(table), ""]
    if document.notes:
        lines += ["## Notes", "", *markdown_list(document.notes)]
    return "\n".join(lines).rstrip("\n") + "\n"


def markdown_lines(table: Table) -> list[str]:
    """A pipe table without its title."""

    def piped(cells: Sequence[str]) -> str:
        shown = (markdown_text(cell).replace("|", "\\|") for cell in cells)
        return f"| {' | '.join(shown)} |"

    marks = ["---" if table.is_left(i) else "---:" for i in range(table.width)]
    return [piped(table.columns), f"|{'|'.join(marks)}|", *map(piped, table.rows)]


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


# ---- HTML, for the pages of a run


def render_html(document: Document) -> str:
    """A scrolling ``table.results`` for each, with its title as caption, then the notes as a list."""
    items = "".join(f"<li>{escape(note)}</li>" for note in document.notes)
    listed = f'<ul class="small">{items}</ul>' if items else ""
    return "".join(map(_html_table, document.tables)) + listed


def _html_table(table: Table) -> str:
    def cell(column: int, text: str, kind: str = "td", scope: str = "") -> str:
        amount = "" if table.is_left(column) else ' class="amount"'
        return f"<{kind}{scope}{amount}>{escape(text)}</{kind}>"

    head = "".join(cell(i, text, "th", ' scope="col"') for i, text in enumerate(table.columns))
    body = ""
    for row in table.shown_rows():
        kinds = [("th", ' scope="row"') if i < table.names else ("td", "") for i in range(len(row))]
        cells = "".join(cell(i, text, *kinds[i]) for i, text in enumerate(row))
        group = ' class="group"' if row[0] else ""
        body += f"<tr{group}>{cells}</tr>"
    title = escape(table.title)
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{title}"><table class="results">'
        f"<caption>{title}</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


# ---- LaTeX, for papers


def render_latex(document: Document) -> str:
    """A ``table`` environment for each; needs the package booktabs. Lead and notes are comments."""
    lines = ["% \\usepackage{booktabs}"]
    lines += [f"% {printable(document.lead)}"] if document.lead else []
    for table in document.tables[: document.paper or None]:
        align = "".join("l" if table.is_left(i) else "r" for i in range(table.width))
        lines += ["\\begin{table}[t]", "\\centering", "\\small"]
        lines += [f"\\begin{{tabular}}{{@{{}}{align}@{{}}}}", "\\toprule"]
        lines += [_ampersands(table.columns), "\\midrule"]
        for i, row in enumerate(table.shown_rows()):
            lines += ["\\midrule"] * (i > 0 and table.grouped and bool(row[0]))
            lines.append(_ampersands(row))
        lines += ["\\bottomrule", "\\end{tabular}", f"\\caption{{{_tex(table.title)}.}}"]
        lines += ["\\end{table}", ""]
    lines += [f"% {printable(note)}" for note in document.notes]
    return "\n".join(lines).rstrip("\n") + "\n"


def _ampersands(cells: Sequence[str]) -> str:
    return " & ".join(map(_tex, cells)) + " \\\\"


_SPECIAL = {
    "\\": "\\textbackslash{}", "~": "\\textasciitilde{}", "^": "\\textasciicircum{}",
    **{c: f"\\{c}" for c in "&%$#_{}"}, "±": "$\\pm$", "↑": "$\\uparrow$", "↓": "$\\downarrow$",
    "–": "--", "−": "$-$", "×": "$\\times$",
}  # fmt: skip


def _tex(text: str) -> str:
    match = re.fullmatch(r"([\d.–]+) ± ([\d.–]+)(.*)", text)
    if match:
        mean, std, rest = (part.replace("–", "\\text{--}") for part in match.groups())
        return f"${mean}\\,{{\\scriptstyle\\pm\\,{std}}}${rest}"
    return "".join(_SPECIAL.get(c, c) for c in printable(text))
