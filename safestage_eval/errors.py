"""What can be wrong with a user's input, said so that it can be mended.

Every message has the same four parts: *where* (file, row, line), *what* is wrong, what is
*allowed*, and how to *fix* it. The command line prints them as they are and exits with 2.
"""

from __future__ import annotations

from dataclasses import dataclass


def readable(text: object) -> str:
    r"""The text of a path, or of a message about one, that can be written down anywhere.

    Bytes of a file name that are no UTF-8 come to stand for themselves (``\udcff``).
    """
    told = str(text)
    return told if told.isascii() else told.encode("utf-8", "backslashreplace").decode()


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
        """``where: what Allowed: … Fix: …`` in one line."""
        what = self.what.rstrip(".") + "." if self.what.endswith("..") else self.what
        stop = "" if what.endswith((".", "?", "!", ":")) else "."
        parts = [f"{self.where}: {what}{stop}"]
        if self.allowed:
            parts.append(f"Allowed: {self.allowed}.")
        if self.fix:
            parts.append(f"Fix: {self.fix}" + ("" if self.fix.endswith("?") else "."))
        return readable(" ".join(parts))


class TraceError(InputError):
    """A stored or in-memory trace that breaks the format (docs/traces.md)."""


class RuleError(InputError):
    """A rule file that does not mean anything yet; see also ``rules.Diagnostic``."""
