"""How long lines for people may be, and lines folded to that length, never within a word."""

from __future__ import annotations

import re
from contextvars import ContextVar

LINE_WIDTH: ContextVar[int | None] = ContextVar("LINE_WIDTH", default=None)
"""Characters per line of tables and messages for people; None where lines are never folded: in files,
in pipes, in tests."""

HANGING = 0.6
"""Share of a line, at the most, by which what follows of it is indented."""

_COLUMN = re.compile(r"(?<=\S)\s{2,}(?=\S)")


def fold(line: str, width: int | None) -> list[str]:
    """A line in pieces of at most ``width`` characters, broken at spaces.

    What follows hangs under the last column of the line, columns being two spaces apart. A word that is
    longer than a line stays whole.
    """
    from rich.cells import cell_len

    if width is None or cell_len(line) <= width:
        return [line]
    first = len(line) - len(line.lstrip())
    columns = [first + 2, *(gap.end() for gap in _COLUMN.finditer(line, first))]
    hang = max([column for column in columns if column <= HANGING * width], default=0)
    lines = [line[:first]]
    for space, word in re.findall(r"(\s*)(\S+)", line[first:]):
        if lines[-1].strip() and cell_len(lines[-1] + space + word) > width:
            lines.append(" " * min(hang, max(width - cell_len(word), first)) + word)
        else:
            lines[-1] += space + word
    return lines


def folded(text: str, width: int | None) -> str:
    """Several lines, each of them folded."""
    return "\n".join(part for line in text.split("\n") for part in fold(line, width))
