"""Annotations of GitHub Actions: workflow commands."""

from __future__ import annotations

from safestage_eval._text.printable import printable_lines


def github_line(level: str, title: str, message: str) -> str:
    """A workflow command of one of the levels error, warning and notice, with its line break."""
    return f"::{level} title={_escaped(title, field=True)}::{_escaped(message)}\n"


def _escaped(text: str, *, field: bool = False) -> str:
    text = printable_lines(text)
    for raw, code in (("%", "%25"), ("\r", "%0D"), ("\n", "%0A")):
        text = text.replace(raw, code)
    return text.replace(":", "%3A").replace(",", "%2C") if field else text
