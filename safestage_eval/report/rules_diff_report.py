"""Two rule sets compared, as text and as plain values."""

from __future__ import annotations

import json
from dataclasses import asdict

from safestage_eval.rules.compare import Comparison
from safestage_eval.rules.parts import Part


def text(found: Comparison) -> str:
    """What changed, most shared first; then which rules mean something else."""
    lines: list[str] = []
    for sign, table in (("+", found.added), ("-", found.removed)):
        lines += [f"{sign} {code}  {title}" for code, title in table.items()]
    for part, codes in found.shared().items():
        lines.append(f"~ {part}  ({', '.join(codes)})")
    for code, parts in found.own().items():
        lines += [f"~ {code}  {part}" for part in parts]
    lines += [f"~ {said}" for said in found.others]
    lines += [f"  {part}  (read by no rule of both)" for part in found.unread]
    if lines:
        lines.append("")
    for code, (before, after) in found.digests.items():
        lines.append(f"{code} means something else: digest {before} → {after}")
    if found.same:
        lines.append(f"mean the same: {', '.join(found.same)}")
    return "\n".join(lines) + "\n"


def as_json(found: Comparison) -> str:
    """The same as one object."""
    document = {
        "added": dict(found.added),
        "removed": dict(found.removed),
        "changed": {
            code: {
                "digest": list(found.digests[code]),
                "parts": [_part(part) for part in parts],
            }
            for code, parts in found.changed.items()
        },
        "same": list(found.same),
        "others": list(found.others),
        "unread": [_part(part) for part in found.unread],
    }
    return json.dumps(document, indent=1, ensure_ascii=False) + "\n"


def _part(part: Part) -> dict[str, str | None]:
    return {**asdict(part), "said": str(part)}
