"""Problems of rule files: where exactly, and how to mend them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from safestage_eval.errors import RuleError, shortened


@dataclass(frozen=True, order=True)
class Diagnostic:
    """One thing that is wrong in a rule file.

    Attributes:
        path: of the file.
        line, column: counted from 1.
        code: stable name of the kind of problem (``R407``); docs/rules.md lists them.
        what: what is wrong.
        allowed: what would have been accepted; empty when *what* already says it.
        fix: what to do about it; empty when there is nothing to add.
        source: the line of the file; of a very long one, what is around the column.
        length: number of characters that are meant, from ``column`` on.
        cut: characters of the line before ``source``.
    """

    path: str
    line: int
    column: int
    code: str
    what: str
    allowed: str = ""
    fix: str = ""
    source: str = field(default="", compare=False)
    length: int = field(default=1, compare=False)
    cut: int = field(default=0, compare=False)

    def render(self) -> str:
        """Several lines: the message, the place, the line of the file with a caret, the help."""
        number = str(self.line)
        margin = " " * len(number)
        lead = "".join(
            "\t" if c == "\t" else " " for c in self.source[: self.column - 1 - self.cut]
        )
        lines = [
            f"error[{self.code}]: {shortened(self.what)}",
            f"{margin}--> {self.path}:{self.line}:{self.column}",
            f"{margin} |",
            f"{number} | {self.source}",
            f"{margin} | {lead}{'^' * min(self.length, max(1, len(self.source) - len(lead)))}",
        ]
        lines += [f"{margin} = fix: {shortened(self.fix)}"] if self.fix else []
        lines += [f"{margin} = allowed: {shortened(self.allowed)}"] if self.allowed else []
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)


MOST = 100
"""Problems that are printed one by one."""


def rendered(diagnostics: Sequence[Diagnostic]) -> list[str]:
    """Each as text; of very many the first, and how many more there are."""
    more = len(diagnostics) - MOST
    texts = [diagnostic.render() for diagnostic in diagnostics[:MOST]]
    return [*texts, f"… and {more:,} more"] if more > 0 else texts


class RuleErrors(RuleError):  # noqa: N818 — it holds many
    """Rule files that cannot be used, with everything that is wrong with them.

    Attributes:
        diagnostics: at least one, in the order of files and lines.
    """

    def __init__(self, diagnostics: Sequence[Diagnostic]) -> None:
        """Collect; the diagnostics are sorted."""
        self.diagnostics = sorted(diagnostics)
        files = list(dict.fromkeys(d.path for d in self.diagnostics))
        count = len(self.diagnostics)
        super().__init__(
            where=", ".join(files),
            what=f"{count} problem{'s' if count != 1 else ''} in the rules.",
        )
        self.args = (self.diagnostics,)

    def __str__(self) -> str:
        """The diagnostics as rendered, then their number."""
        return "\n\n".join([*rendered(self.diagnostics), super().__str__()])
