"""Tables of words, laid out as text, as Markdown and as LaTeX."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Sheet:
    """One table: a title, names of columns, and rows of words.

    The first ``names`` columns say what a row is of, the others hold numbers. A name that repeats
    the one above it is left out where that reads better.
    """

    title: str
    columns: tuple[str, ...]
    rows: Sequence[Sequence[str]]
    names: int


def as_text(sheets: Sequence[Sheet], notes: Sequence[str] = ()) -> str:
    """Columns under each other; never wrapped."""
    lines: list[str] = []
    for sheet in sheets:
        rows = [list(sheet.columns), *_without_repeats(sheet)]
        width = [max(len(row[i]) for row in rows) for i in range(len(sheet.columns))]
        laid = [
            "  ".join(
                cell.ljust(size) if i < sheet.names else cell.rjust(size)
                for i, (cell, size) in enumerate(zip(row, width, strict=True))
            ).rstrip()
            for row in rows
        ]
        lines += [sheet.title, laid[0], "─" * (sum(width) + 2 * (len(width) - 1)), *laid[1:], ""]
    return "\n".join([*lines, *notes]).rstrip("\n") + "\n"


def as_markdown(sheets: Sequence[Sheet], notes: Sequence[str] = ()) -> str:
    """A section with a table for each, then the notes as a list."""
    lines: list[str] = []
    for sheet in sheets:
        rules = ["---" if i < sheet.names else "---:" for i in range(len(sheet.columns))]
        lines += [f"## {sheet.title}", "", _piped(sheet.columns), f"|{'|'.join(rules)}|"]
        lines += [*(_piped(row) for row in sheet.rows), ""]
    if notes:
        lines += ["## Notes", "", *(f"- {note}" for note in notes)]
    return "\n".join(lines).rstrip("\n") + "\n"


def as_latex(sheets: Sequence[Sheet], notes: Sequence[str] = ()) -> str:
    """A ``table`` environment for each; needs the package booktabs. Notes are comments."""
    lines = ["% \\usepackage{booktabs}"]
    for sheet in sheets:
        left = sheet.names
        lines += [
            "\\begin{table}[t]",
            "\\centering",
            "\\small",
            f"\\begin{{tabular}}{{@{{}}{'l' * left}{'r' * (len(sheet.columns) - left)}@{{}}}}",
            "\\toprule",
            _ampersands(sheet.columns),
            "\\midrule",
        ]
        above = ""
        for row, shown in zip(sheet.rows, _without_repeats(sheet), strict=True):
            if above and row[0] != above and left > 1:
                lines.append("\\midrule")
            above = row[0]
            lines.append(_ampersands(shown))
        lines += ["\\bottomrule", "\\end{tabular}", f"\\caption{{{_tex(sheet.title)}.}}"]
        lines += ["\\end{table}", ""]
    lines += [f"% {note}" for note in notes]
    return "\n".join(lines).rstrip("\n") + "\n"


def _without_repeats(sheet: Sheet) -> list[list[str]]:
    """Rows in which the first name stands only where it changes."""
    found, above = [], None
    for row in sheet.rows:
        repeats = sheet.names > 1 and row[0] == above
        found.append(["", *row[1:]] if repeats else list(row))
        above = row[0]
    return found


def _piped(cells: Sequence[str]) -> str:
    said = (re.sub(r"\s+", " ", cell).replace("|", "\\|") for cell in cells)
    return f"| {' | '.join(said)} |"


def _ampersands(cells: Sequence[str]) -> str:
    return " & ".join(map(_tex, cells)) + " \\\\"


_SPECIAL = {
    "\\": "\\textbackslash{}", "~": "\\textasciitilde{}", "^": "\\textasciicircum{}",
    **{c: f"\\{c}" for c in "&%$#_{}"}, "±": "$\\pm$", "↑": "$\\uparrow$", "↓": "$\\downarrow$",
    "–": "--", "−": "$-$", "×": "$\\times$",
}  # fmt: skip


def _tex(text: str) -> str:
    found = re.fullmatch(r"([\d.–]+) ± ([\d.–]+)(.*)", text)
    if found:
        mean, std, rest = (part.replace("–", "\\text{--}") for part in found.groups())
        return f"${mean}\\,{{\\scriptstyle\\pm\\,{std}}}${rest}"
    return "".join(_SPECIAL.get(c, c) for c in text)
