"""The JSON Schema of results: of a row, and of the object that ``--format json`` prints.

``python -m safestage_eval.report.result_schema [FOLDER]`` writes it to ``schemas/``.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, get_args

from safestage_eval.verdicts.engagement import Engagement
from safestage_eval.verdicts.verdict import Vacuity, VerdictName

from .result_rows import COLUMNS, KINDS

FILE = "results.schema.json"

_TEXT, _TRUTH, _COUNT, _NUMBER = (
    {"type": kind} for kind in ("string", "boolean", "integer", "number")
)
_PAIR = {"type": "array", "items": _NUMBER, "minItems": 2, "maxItems": 2}

_KINDS: dict[str, dict[str, Any]] = {
    "integer": _COUNT, "boolean": _TRUTH, "number": _NUMBER,
    "strings": {"type": "array", "items": _TEXT}, "pairs": {"type": "array", "items": _PAIR},
}  # fmt: skip

_WORDS = {"verdict": VerdictName, "vacuity": Vacuity, "engagement": Engagement}

_ALWAYS = {
    "episode_id", "path", "rule", "assigned", "bodies", "intervals", "exposure_time",
    "raw_intervals", "undersampled", "instances", "violated_instances", "breaches", "breaches_by_level", "explanation", "notes", "sources",
    "rule_digest", "trace_hash", "version",
}  # fmt: skip
"""Columns that are never null."""


def row_schema() -> dict[str, Any]:
    """Schema of one result row: every column is present, some may be null (docs/results.md)."""
    columns = {}
    for name in COLUMNS:
        kind = _KINDS[KINDS[name]] if name in KINDS else _TEXT
        if name in _WORDS:
            kind = {"enum": list(get_args(_WORDS[name]))}
        columns[name] = kind if name in _ALWAYS else {"anyOf": [kind, {"type": "null"}]}
    return _object(columns)


def results_schema() -> dict[str, Any]:
    """Schema of the whole JSON object."""
    cell = {
        "type": "object",
        "required": ["prompt", "metric", "k", "n"],
        "properties": {
            "policy": _TEXT, "prompt": _TEXT, "stage": _TEXT, "metric": _TEXT,
            "value": {"anyOf": [_NUMBER, {"type": "null"}]}, "k": _COUNT, "n": _COUNT,
        },
    }  # fmt: skip
    cells = {"type": "array", "items": cell}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "SafeStage results",
        **_object(
            {
                "version": _TEXT,
                "rules": {"type": "object", "additionalProperties": _TEXT},
                "episodes": {"type": "array", "items": row_schema()},
                "metrics": _object(
                    {
                        "headline": {"type": "object"},
                        "by_policy": cells,
                        "by_stage": cells,
                        "by_rule": {"type": "array", "items": {"type": "object"}},
                    }
                ),
                "problems": {
                    "type": "array",
                    "items": _object({"path": _TEXT, "message": _TEXT}),
                },
            },
            {
                "sample": _TEXT,
                "audit": _object(
                    {
                        "counts": {"type": "object", "additionalProperties": _COUNT},
                        "findings": {"type": "array", "items": {"type": "object"}},
                    }
                ),
            },
        ),
    }


def _object(properties: dict[str, Any], optional: dict[str, Any] | None = None) -> dict[str, Any]:
    both = properties | (optional or {})
    return {"type": "object", "required": list(properties), "properties": both}


def schema_text() -> str:
    """The file's content."""
    return json.dumps(results_schema(), indent=1) + "\n"


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "schemas")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / FILE).write_text(schema_text(), "utf-8")
