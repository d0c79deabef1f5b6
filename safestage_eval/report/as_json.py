"""Results as one JSON object, or as one JSON object per line and row."""

from __future__ import annotations

import json

from safestage_eval.scoring import Scores

from .rows import document, rows


def render(scores: Scores) -> str:
    """``{"version", "rules", "episodes", "metrics", "problems"}``."""
    return json.dumps(document(scores), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def render_lines(scores: Scores) -> str:
    """One row per line."""
    return "".join(
        json.dumps(row, ensure_ascii=False, allow_nan=False) + "\n" for row in rows(scores)
    )
