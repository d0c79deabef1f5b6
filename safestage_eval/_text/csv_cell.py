"""Texts in CSV files that a spreadsheet takes for text."""

from __future__ import annotations

import re

from .printable import printable

_FORMULA = re.compile(r"[=+\-@＝＋－＠]")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_GUARDED = re.compile(r"'+[=+\-@＝＋－＠]")


def to_cell(text: str) -> str:
    """The text on one line, ``guarded``."""
    return guarded(printable(text))


def guarded(text: str) -> str:
    """The text, behind an apostrophe where a spreadsheet would calculate it."""
    calculates = _FORMULA.match(text) and not _NUMBER.fullmatch(text)
    return f"'{text}" if calculates or _GUARDED.match(text) else text


def from_cell(cell: str) -> str:
    """The text of a cell, without the apostrophe that ``guarded`` has put before it."""
    return cell[1:] if _GUARDED.match(cell) else cell
