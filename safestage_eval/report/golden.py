"""Expected verdicts, kept beside traces, and what differs from them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.scoring import Scores
from safestage_eval.verdicts import EpisodeResult, Verdict

TIME_TOLERANCE = 0.02
"""s: two frames at 120 Hz."""
VALUE_TOLERANCE = 1e-3
"""Relative, and in SI absolute: rounding of another machine, not another verdict."""


def golden(scores: Scores) -> dict[str, Any]:
    """Episode id → success, trace hash, and verdict, time, value, limit of each assigned rule."""
    return {
        "format": 1,
        "episodes": {r.episode_id: _expected(r) for r in sorted(scores.results, key=_id)},
    }


def write_golden(scores: Scores, path: Path) -> None:
    """Write the expectations, replacing the file whole."""
    temporary = path.with_name(path.name + ".tmp")
    temporary.write_text(json.dumps(golden(scores), indent=1) + "\n", encoding="utf-8")
    temporary.replace(path)


def compare_golden(scores: Scores, path: Path) -> list[str]:
    """What differs, one line each; empty when everything is as expected.

    Raises InputError when the file is not there or is no golden file.
    """
    try:
        wanted = json.loads(path.read_text(encoding="utf-8"))["episodes"]
    except FileNotFoundError:
        raise InputError(
            str(path), "no such golden file.", fix="write it with --update-golden"
        ) from None
    except (ValueError, KeyError, TypeError):
        raise InputError(
            str(path), "not a golden file.", "JSON written by --update-golden"
        ) from None
    found = {r.episode_id: r for r in scores.results}
    lines = [f"{name}: expected, but not among the traces" for name in wanted if name not in found]
    for name, result in found.items():
        if name not in wanted:
            lines.append(f"{name}: not in the golden file (add it with --update-golden)")
        else:
            lines += [f"{name}: {line}" for line in _differences(wanted[name], result)]
    return lines


def _id(result: EpisodeResult) -> str:
    return result.episode_id


def _expected(result: EpisodeResult) -> dict[str, Any]:
    return {
        "trace_hash": result.trace_hash,
        "success": result.success,
        "success_time": _rounded(result.success_time),
        "rules": {v.rule: _verdict(v) for v in result.assigned},
    }


def _verdict(v: Verdict) -> dict[str, Any]:
    return {
        "verdict": v.verdict,
        "time": _rounded(v.time),
        "signal": v.signal,
        "value": _rounded(v.value),
        "limit": _rounded(v.limit),
        "rule_digest": v.rule_digest,
    }


def _differences(wanted: dict[str, Any], result: EpisodeResult) -> list[str]:
    found = _expected(result)
    lines = []
    changed_trace = wanted["trace_hash"] != found["trace_hash"]
    if changed_trace:
        lines.append("the trace is not the one the expectations were made for")
    if wanted["success"] != found["success"]:
        lines.append(f"success was {wanted['success']}, is {found['success']}")
    for rule in sorted({*wanted["rules"], *found["rules"]}):
        before, now = wanted["rules"].get(rule), found["rules"].get(rule)
        if before is None or now is None:
            lines.append(f"{rule}: {'was not' if before is None else 'is no longer'} assigned")
            continue
        changes = [
            f"{name} {_shown(before[name])} → {_shown(now[name])}"
            for name in ("verdict", "time", "signal", "value", "limit")
            if not _same(name, before[name], now[name])
        ]
        if changes:
            why = (
                "the rule's meaning changed"
                if before["rule_digest"] != now["rule_digest"]
                else "the trace changed"
                if changed_trace
                else "rule and trace are the same: the evaluator changed"
            )
            lines.append(f"{rule}: {', '.join(changes)} ({why})")
    return lines


def _same(name: str, before: Any, now: Any) -> bool:
    if isinstance(before, int | float) and isinstance(now, int | float):
        if name == "time":
            return abs(before - now) <= TIME_TOLERANCE
        return math.isclose(before, now, rel_tol=VALUE_TOLERANCE, abs_tol=VALUE_TOLERANCE)
    return bool(before == now)


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 6)


def _shown(value: Any) -> str:
    return "none" if value is None else f"{value:.4g}" if isinstance(value, float) else str(value)
