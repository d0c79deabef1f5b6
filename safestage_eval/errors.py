"""Errors in a user's input, worded so that the user can fix them.

Every message has the same four parts: *where* (file, row, line), *what* is wrong, what is
*allowed*, and how to *fix* it. The command line prints them as they are and exits with 2.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass


def readable(text: object) -> str:
    r"""The text of a path, or of a message about one, that can be written down anywhere.

    Bytes of a file name that are no UTF-8 come to stand for themselves (``\udcff``).
    """
    shown = str(text)
    return shown if shown.isascii() else shown.encode("utf-8", "backslashreplace").decode()


def visible(text: str) -> str:
    r"""The text on one line, with every control or invisible character as an escape (``\x1b``)."""
    return text if text.isprintable() else "".join(map(_seen, text))


def _seen(character: str) -> str:
    if character.isprintable() or unicodedata.category(character) == "Zs":
        return character
    return character.encode("unicode_escape").decode("ascii")


def nearest(name: str, among: Iterable[str], least: float = 0.6) -> str:
    """The name that is probably meant; empty where none is alike enough, 0…1."""
    from difflib import get_close_matches  # only where something is wrong

    return next(iter(get_close_matches(name, [*among], 1, least)), "")


def did_you_mean(name: str, among: Iterable[str], least: float = 0.6) -> str:
    """``did you mean "x"?``; empty where none is alike enough, 0…1."""
    near = nearest(name, among, least)
    return f'did you mean "{near}"?' if near else ""


LONGEST = 600
"""Characters of a part of a message: names and lists in it may be a stranger's."""


def shortened(text: str, most: int = LONGEST) -> str:
    """A text without its middle, if it is longer than that."""
    if len(text) <= most:
        return text
    half = most // 2
    return f"{text[:half]} … ({len(text) - 2 * half:,} characters left out) … {text[-half:]}"


@dataclass
class InputError(Exception):
    """A trace, rule file or argument that cannot be used as it is.

    Attributes:
        where: file path, possibly with a place inside it (``"a.mcap, byte 4096"``).
        what: what is wrong, in one sentence.
        allowed: what would have been accepted; empty when *what* already says it.
        fix: what the user can do about it; empty when there is nothing to add.
    """

    where: str
    what: str
    allowed: str = ""
    fix: str = ""

    def __str__(self) -> str:
        """``where: what Allowed: … Fix: …`` in one line that is not too long and moves no cursor."""
        what = self.what.rstrip(".") + "." if self.what.endswith("..") else self.what
        what = shortened(what)
        stop = "" if what.endswith((".", "?", "!", ":")) else "."
        parts = [f"{shortened(self.where)}: {what}{stop}"]
        if self.allowed:
            parts.append(f"Allowed: {shortened(self.allowed)}.")
        if self.fix:
            parts.append(f"Fix: {shortened(self.fix)}" + ("" if self.fix.endswith("?") else "."))
        return visible(" ".join(parts))


class TraceError(InputError):
    """A stored or in-memory trace that breaks the format (docs/traces.md)."""


class RuleError(InputError):
    """A rule file that cannot be used as it is; see also ``rules.Diagnostic``."""
