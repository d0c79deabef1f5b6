"""Text that is safe to show: names in traces and rule files come from strangers."""

from __future__ import annotations

from safestage_eval.errors import visible


def printable(text: str) -> str:
    r"""The text on one line, with every control or invisible character as an escape (``\x1b``).

    Line breaks, terminal sequences, changes of writing direction and halves of surrogate pairs
    are escaped; letters of any script and spaces of any width stay.
    """
    return visible(text)


def printable_lines(text: str) -> str:
    """Several lines, each made printable; line feeds and tabulators stay."""
    lines = (line.split("\t") for line in text.split("\n"))
    return "\n".join("\t".join(map(printable, parts)) for parts in lines)
