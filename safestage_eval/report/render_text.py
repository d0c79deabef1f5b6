"""Reports as plain text for a terminal: lines that fit, columns under each other, colours where they are wanted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import zip_longest

from rich.cells import cell_len
from rich.color import ColorSystem
from rich.style import Style

from safestage_eval._text.line_width import fold
from safestage_eval._text.printable import printable

from .table import Table

GAP = "  "

SENTENCE = 24
"""Characters of a line of a column of sentences, at the least."""

WIDTH = 100
"""Characters per line where there is no terminal; lines are wrapped, never cut off."""

LEAST = 50
"""Below this the columns leave no room for sentences, and letters would be lost."""


class Sheet:
    """Lines for a terminal of some width, with colours if there is one."""

    def __init__(self, width: int | None, *, color: bool = False) -> None:
        self.width, self._color = max(width or WIDTH, LEAST), color
        self._lines: list[str] = []

    def put(self, text: str = "", style: str = "", *, mark: tuple[str, str] | None = None) -> None:
        """Add a line, folded between words; ``mark``: a word of it with a style of its own."""
        for folded in fold(printable(text), self.width):
            line = folded.rstrip()
            before, word, after = line.partition(mark[0]) if mark and mark[0] else (line, "", "")
            marked = self._styled(word, mark[1]) if mark else ""
            self._lines.append(self._styled(before, style) + marked + self._styled(after, style))
            mark = None if word else mark

    def table(self, table: Table) -> None:
        """Add a table with its heads in bold."""
        for i, line in enumerate(text_lines(table, self.width)):
            self._lines.append(self._styled(line, "bold" * (i == 0)))

    def _styled(self, text: str, style: str) -> str:
        if not (self._color and style and text):
            return text
        return Style.parse(style).render(text, color_system=ColorSystem.EIGHT_BIT)

    def __str__(self) -> str:
        """All lines."""
        return "\n".join(self._lines) + "\n"


def text_lines(table: Table, width: int | None = None) -> list[str]:
    """Title, heads and rows, columns under each other.

    Where that is wider than ``width`` characters, heads and words are set on several lines; where that
    does not help, the columns are shown some at a time, the names of the rows before each time.
    """
    lines = fold(printable(table.title), width) if table.title else []
    rows = [[printable(cell) for cell in row] for row in table.shown_rows()]
    head = [printable(cell) for cell in table.columns]
    if not head and not rows:
        return lines
    columns = [_Column(table, i, head, rows) for i in range(table.width)]
    for i, part in enumerate(_parts(columns, table.names, width)):
        lines += [""] * (i > 0)
        lines += _part(part, width, with_head=bool(head), ruled=bool(table.title))
    return lines


class _Column:
    """The cells of a column, its head first if there is one, and how wide it is."""

    def __init__(self, table: Table, i: int, head: list[str], rows: list[list[str]]) -> None:
        self.left = table.is_left(i)
        self.cells = [*head[i : i + 1], *(row[i] for row in rows)]
        whole = [] if self.left else self.cells[len(head[i : i + 1]) :]  # numbers stay on one line
        words = [word for cell in (self.cells if self.left else head[i : i + 1]) for word in cell.split()]  # fmt: skip
        self.most = max(map(cell_len, self.cells))
        self.least = max(map(cell_len, [*whole, *words]), default=0)
        sentences = i >= table.width - table.texts
        self.room = max(self.least, min(SENTENCE, self.most)) if sentences else self.least

    def lines(self, row: int, size: int) -> list[str]:
        """A cell on as many lines as it needs."""
        text, lines = self.cells[row], [""]
        if cell_len(text) <= size:
            return [text]
        for word in text.split():
            longer = f"{lines[-1]} {word}".strip()
            if lines[-1] and cell_len(longer) > size:
                lines.append(word)
            else:
                lines[-1] = longer
        return lines

    def aligned(self, text: str, size: int) -> str:
        space = " " * (size - cell_len(text))
        return text + space if self.left else space + text


def _fit(sizes: Sequence[int], width: int | None) -> bool:
    return width is None or sum(sizes) + len(GAP) * (len(sizes) - 1) <= width


def _parts(columns: list[_Column], names: int, width: int | None) -> Iterator[list[_Column]]:
    """Columns that fit the width together, in order, behind those that name the rows."""
    now, fresh = columns[:names], True
    for column in columns[names:]:
        if not _fit([c.room for c in (*now, column)], width):
            if fresh:
                yield now
            now, fresh = columns[:names], False
            while len(now) > 1 and not _fit([c.room for c in (*now, column)], width):
                now.pop()  # the first name still tells the row
        now, fresh = [*now, column], True
    yield now


def _part(
    columns: list[_Column], width: int | None, *, with_head: bool, ruled: bool
) -> Iterator[str]:
    """Heads, a rule, and rows, of some columns."""
    sizes = [c.most for c in columns]
    if width is not None and not _fit(sizes, width):
        rooms = [c.room for c in columns]
        least = rooms if _fit(rooms, width) else [c.least for c in columns]
        free = max(width - sum(least) - len(GAP) * (len(columns) - 1), 0)
        for i in sorted(range(len(columns)), key=lambda i: sizes[i] - least[i]):
            more = min(sizes[i] - least[i], free)  # the longest gets the rest
            sizes[i], free = least[i] + more, free - more
    for row in range(len(columns[0].cells)):
        cells = [c.lines(row, size) for c, size in zip(columns, sizes, strict=True)]
        is_head = with_head and row == 0
        if is_head:  # heads stand on the rule
            most = max(map(len, cells))
            cells = [[""] * (most - len(cell)) + cell for cell in cells]
        for line in zip_longest(*cells, fillvalue=""):
            parts = zip(columns, line, sizes, strict=True)
            yield GAP.join(c.aligned(text, size) for c, text, size in parts).rstrip()
        if is_head and ruled:
            yield "─" * (sum(sizes) + len(GAP) * (len(columns) - 1))
