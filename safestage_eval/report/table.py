"""A table of words, whatever it is written as."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Table:
    """A title, heads of columns, and rows of words.

    Attributes:
        title: above the table; empty for none.
        columns: heads; empty for a table without.
        rows: as many cells each.
        names: how many leading columns name the row; these are aligned left, numbers right.
        texts: how many trailing columns hold sentences, aligned left.
        grouped: leave out a row's leading names where they repeat those above; the last name stays.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    names: int
    texts: int = 0
    grouped: bool = False

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.columns or (self.rows[0] if self.rows else ()))

    def is_left(self, column: int) -> bool:
        """Whether a column is aligned left."""
        return column < self.names or column >= self.width - self.texts

    def shown_rows(self) -> list[list[str]]:
        """The rows; if ``grouped``, without leading names (but the last) that repeat the row above."""
        rows: list[list[str]] = []
        above: Sequence[str] = ()
        for row in self.rows:
            repeats = 0
            while self.grouped and repeats < self.names - 1 and [*row[: repeats + 1]] == [*above[: repeats + 1]]:  # fmt: skip
                repeats += 1
            rows.append([""] * repeats + [*row[repeats:]])
            above = row
        return rows


def table_of(
    title: str,
    items: Iterable[Any],
    columns: Mapping[str, Callable[[Any], str]],
    names: int,
    *,
    texts: int = 0,
    grouped: bool = False,
) -> Table:
    """A row for each item; ``columns``: head → what its cell says of an item."""
    rows = [[cell(item) for cell in columns.values()] for item in items]
    return Table(title, (*columns,), rows, names, texts, grouped)
