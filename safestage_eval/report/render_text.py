"""Tables as plain text for a terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import zip_longest

from rich.cells import cell_len

from safestage_eval._text.line_width import LINE_WIDTH, fold
from safestage_eval._text.printable import printable

from .table import Table

GAP = "  "

SENTENCE = 24
"""Characters of a line of a column of sentences, at the least."""

Cells = list[list[str]]


def render_text(tables: Sequence[Table], notes: Sequence[str] = (), lead: str = "") -> str:
    """The lead, each table and an empty line, then the notes; no line longer than ``LINE_WIDTH``."""
    width = LINE_WIDTH.get()
    lines = [*fold(printable(lead), width), ""] if lead else []
    for table in tables:
        lines += [*text_lines(table, width), ""]
    notes = [part for note in notes for part in fold(printable(note), width)]
    return "\n".join([*lines, *notes]).rstrip("\n") + "\n"


def text_lines(table: Table, width: int | None = None) -> list[str]:
    """Title, heads and rows, columns under each other.

    Where that is wider than ``width`` characters, heads and words are set on several lines; where that
    does not help, the columns are shown some at a time, the names of the rows before each time.
    """
    rows: Cells = [[printable(cell) for cell in row] for row in table.shown_rows()]
    head = [printable(cell) for cell in table.columns]
    lines = fold(printable(table.title), width) if table.title else []
    for i, columns in enumerate(_blocks(table, head, rows, width)):
        lines += [""] * (i > 0)
        lines += _block(table, head, rows, columns, width)
    return lines


def _blocks(
    table: Table, head: list[str], rows: Cells, width: int | None
) -> Iterator[tuple[int, ...]]:
    """Groups of columns that fit the width, in order."""
    names = [*range(min(table.names, table.width))]
    least = [_room(table, head, rows, i) for i in range(table.width)]

    def fits(columns: list[int]) -> bool:
        wide = sum(least[i] for i in columns) + len(GAP) * (len(columns) - 1)
        return width is None or wide <= width

    shown: set[int] = set()
    now = [*names]
    for i in range(table.names, table.width):
        if not fits([*now, i]):
            if not shown.issuperset(now):
                yield tuple(now)
                shown.update(now)
            now = [*names]
            while len(now) > 1 and not fits([*now, i]):  # the first name still tells the row
                now.pop()
        now.append(i)
    yield tuple(now)


def _least(table: Table, head: list[str], rows: Cells, column: int) -> int:
    """Characters that a column needs at the least: those of its longest word; a number is one."""
    words = [word for title in head[column : column + 1] for word in title.split()]
    cells = [row[column] for row in rows]
    text = table.is_left(column)
    words += [word for cell in cells for word in cell.split()] if text else cells
    return max(map(cell_len, words), default=0)


def _room(table: Table, head: list[str], rows: Cells, column: int) -> int:
    """Characters that a column is given at the least, if there is room: sentences want more."""
    least = _least(table, head, rows, column)
    if column < table.width - table.texts:
        return least
    return max(least, min(SENTENCE, _most(head, rows, column)))


def _most(head: list[str], rows: Cells, column: int) -> int:
    """Width of a column in characters, unfolded."""
    return max(map(cell_len, [*head[column : column + 1], *(row[column] for row in rows)]))


def _block(
    table: Table, head: list[str], rows: Cells, columns: Sequence[int], width: int | None
) -> Iterator[str]:
    """Heads, a rule, and rows, of some columns."""
    if not rows and not head:
        return
    sizes = {i: _most(head, rows, i) for i in columns}
    gaps = len(GAP) * (len(columns) - 1)
    if width is not None and sum(sizes.values()) + gaps > width:
        least = {i: _room(table, head, rows, i) for i in columns}
        if sum(least.values()) + gaps > width:
            least = {i: _least(table, head, rows, i) for i in columns}
        free = max(width - gaps - sum(least.values()), 0)
        for i in sorted(columns, key=lambda i: sizes[i] - least[i]):  # the longest gets the rest
            more = min(sizes[i] - least[i], free)
            sizes[i], free = least[i] + more, free - more
    for n, row in enumerate([head, *rows] if head else rows):
        parts = [_wrapped(row[i], sizes[i]) for i in columns]
        if n == 0 and head:  # heads stand on the rule
            most = max(map(len, parts))
            parts = [[""] * (most - len(part)) + part for part in parts]
        for line in zip_longest(*parts, fillvalue=""):
            cells = zip(columns, line, strict=True)
            yield GAP.join(_aligned(c, sizes[i], table.is_left(i)) for i, c in cells).rstrip()
        if n == 0 and head and table.title:
            yield "─" * (sum(sizes.values()) + gaps)


def _wrapped(text: str, size: int) -> list[str]:
    """The lines of a cell."""
    if cell_len(text) <= size:
        return [text]
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and cell_len(longer) > size:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def _aligned(text: str, size: int, left: bool) -> str:
    space = " " * (size - cell_len(text))
    return text + space if left else space + text
