"""Text that is safe to show: names in traces and rule files come from strangers."""

from __future__ import annotations

import unicodedata


def printable(text: str) -> str:
    r"""The text on one line, with every control or invisible character as an escape (``\x1b``).

    Line breaks, terminal sequences, changes of writing direction and halves of surrogate pairs
    are escaped; letters of any script and spaces of any width stay.
    """
    return text if text.isprintable() else "".join(map(_shown, text))


def printable_lines(text: str) -> str:
    """Several lines, each made printable; line feeds and tabulators stay."""
    lines = (line.split("\t") for line in text.split("\n"))
    return "\n".join("\t".join(map(printable, parts)) for parts in lines)


def _shown(character: str) -> str:
    if character.isprintable() or unicodedata.category(character) == "Zs":
        return character
    return character.encode("unicode_escape").decode("ascii")
