"""Two rule sets compared, as text."""

from __future__ import annotations

from safestage_eval.rules.compare import Comparison


def text(comparison: Comparison) -> str:
    """List what changed, parts that most rules share first; then the rules whose meaning changed."""
    lines: list[str] = []
    for sign, table in (("+", comparison.added), ("-", comparison.removed)):
        lines += [f"{sign} {code}  {title}" for code, title in table.items()]
    for part, codes in comparison.shared().items():
        lines.append(f"~ {part}  ({', '.join(codes)})")
    for code, parts in comparison.own().items():
        lines += [f"~ {code}  {part}" for part in parts]
    lines += [f"~ {said}" for said in comparison.others]
    lines += [f"  {part}  (read by no rule of both)" for part in comparison.unread]
    if lines:
        lines.append("")
    for code, (before, after) in comparison.digests.items():
        lines.append(f"{code}: rule or parameter changed: {before} → {after}")
    if comparison.same:
        lines.append(f"mean the same: {', '.join(comparison.same)}")
    return "\n".join(lines) + "\n"
