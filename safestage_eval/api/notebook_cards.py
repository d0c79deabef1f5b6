"""HTML for notebooks: cards, tables, texts, pictures and pages. Words from traces are escaped."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any

from safestage_eval._text.printable import printable
from safestage_eval.palette import SIGNS, VERDICTS

STYLE = "overflow-x:auto;border:1px solid #8886;border-radius:6px;padding:.6em .9em;margin:.3em 0;max-width:60em"
CELL = "text-align:left;padding:.15em .8em .15em 0;vertical-align:top"


def words(text: object) -> str:
    """Text as HTML, its control characters shown."""
    return escape(printable(str(text)))


def card(title: str, *parts: str) -> str:
    """A framed box; ``parts`` are HTML."""
    return f'<div style="{STYLE}"><strong>{words(title)}</strong>{"".join(parts)}</div>'


def facts(rows: Mapping[str, object]) -> str:
    """Names and what they are."""
    return table((), rows.items())


def table(heads: Sequence[str], rows: Iterable[Iterable[object]], most: int = 20) -> str:
    """A table; of many rows the first ones, and how many more there are."""
    kept = [tuple(row) for row in rows]
    head = "".join(f'<th style="{CELL}">{words(name)}</th>' for name in heads)
    body = "".join("<tr>" + "".join(_cell(cell) for cell in row) + "</tr>" for row in kept[:most])
    more = f"<p>and {len(kept) - most} more</p>" if len(kept) > most else ""
    return f"<table>{f'<tr>{head}</tr>' if heads else ''}{body}</table>{more}"


def _cell(cell: object) -> str:
    """Numbers and other short words stay on one line."""
    shown = words(cell)
    style = f"{CELL};white-space:nowrap" if len(shown) < 14 else CELL
    return f'<td style="{style}">{shown}</td>'


def verdict(word: str) -> str:
    """A verdict with its sign, in its colour."""
    said = f"{SIGNS[word]} {word.replace('_', ' ')}"
    color = VERDICTS[word].light
    return f'<span style="color:{color};font-weight:600">{words(said)}</span>'


class Text(str):
    """Text that notebooks and consoles show as it is, line by line."""

    __slots__ = ()

    def __repr__(self) -> str:
        """Itself."""
        return str(self)

    def _repr_html_(self) -> str:
        return f"<pre style='white-space:pre-wrap'>{escape(self)}</pre>"


class Picture:
    """A drawn figure: notebooks show it, ``save`` writes it; ``figure`` is matplotlib's."""

    def __init__(self, figure: Any) -> None:
        self.figure = figure

    def save(self, path: str | Path) -> Path:
        """Write it; the ending says in which format. Raises InputError for none that is known."""
        from safestage_eval.report.figure import write

        write(self.figure, "save", Path(path))
        return Path(path)

    def _repr_png_(self) -> bytes:
        data = BytesIO()
        self.figure.savefig(data, format="png", dpi=110)
        return data.getvalue()


class Page:
    """A page that carries everything: notebooks show it in place, ``path`` is the file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __repr__(self) -> str:
        """Where it is."""
        return str(self.path)

    def open(self) -> bool:
        """Open it in the browser; returns whether there is one."""
        import webbrowser

        return webbrowser.open(self.path.resolve().as_uri())

    def _repr_html_(self) -> str:
        page = escape(self.path.read_text("utf-8"))
        return (
            f'<iframe srcdoc="{page}" style="width:100%;height:46em;border:1px solid #8886" '
            'sandbox="allow-scripts"></iframe>'
        )
