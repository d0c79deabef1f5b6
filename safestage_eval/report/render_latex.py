"""Tables as LaTeX."""

from __future__ import annotations

import re
from collections.abc import Sequence

from safestage_eval._text.printable import printable

from .table import Table


def render_latex(tables: Sequence[Table], notes: Sequence[str] = (), lead: str = "") -> str:
    """A ``table`` environment for each; needs the package booktabs. Lead and notes are comments."""
    lines = ["% \\usepackage{booktabs}", *([f"% {printable(lead)}"] if lead else [])]
    for table in tables:
        align = "".join("l" if table.is_left(i) else "r" for i in range(table.width))
        lines += [
            "\\begin{table}[t]",
            "\\centering",
            "\\small",
            f"\\begin{{tabular}}{{@{{}}{align}@{{}}}}",
            "\\toprule",
            _ampersands(table.columns),
            "\\midrule",
        ]
        above = ""
        for row, shown in zip(table.rows, table.shown_rows(), strict=True):
            if above and row[0] != above and table.grouped:
                lines.append("\\midrule")
            above = row[0]
            lines.append(_ampersands(shown))
        lines += ["\\bottomrule", "\\end{tabular}", f"\\caption{{{_tex(table.title)}.}}"]
        lines += ["\\end{table}", ""]
    lines += [f"% {printable(note)}" for note in notes]
    return "\n".join(lines).rstrip("\n") + "\n"


def _ampersands(cells: Sequence[str]) -> str:
    return " & ".join(map(_tex, cells)) + " \\\\"


_SPECIAL = {
    "\\": "\\textbackslash{}", "~": "\\textasciitilde{}", "^": "\\textasciicircum{}",
    **{c: f"\\{c}" for c in "&%$#_{}"}, "±": "$\\pm$", "↑": "$\\uparrow$", "↓": "$\\downarrow$",
    "–": "--", "−": "$-$", "×": "$\\times$",
}  # fmt: skip


def _tex(text: str) -> str:
    match = re.fullmatch(r"([\d.–]+) ± ([\d.–]+)(.*)", text)
    if match:
        mean, std, rest = (part.replace("–", "\\text{--}") for part in match.groups())
        return f"${mean}\\,{{\\scriptstyle\\pm\\,{std}}}${rest}"
    return "".join(_SPECIAL.get(c, c) for c in printable(text))
