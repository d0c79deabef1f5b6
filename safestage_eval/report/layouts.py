"""The formats that tables for people are written in."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from .render_latex import render_latex
from .render_markdown import render_markdown
from .render_text import render_text
from .table import Table

Layout = Callable[[Sequence[Table], Sequence[str], str], str]
"""Takes tables, notes below them, and a line above them, which may be empty."""

LAYOUTS: dict[str, Layout] = {
    "table": render_text,
    "markdown": render_markdown,
    "latex": render_latex,
}
"""Format → what writes tables and notes in it."""
