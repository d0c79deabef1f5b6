"""Expected verdicts, kept beside traces, and what differs from them."""

from __future__ import annotations

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.scoring import Scores
from safestage_eval.units import format_quantity
from safestage_eval.verdicts import EpisodeResult, Verdict

FORMAT = 1
FRAME = 1 / 120
"""s: times may differ by a frame, because rounding may push a value over its limit that much
sooner or later."""
VALUE_TOLERANCE = 1e-3
"""Relative; rounding of another machine, not another verdict."""
LEAST_TOLERANCE = 1e-4
"""Absolute, SI: 0.1 mm, 0.1 mrad, 0.1 mN."""

_FIELDS = ("verdict", "time", "signal", "value", "limit")


def write_golden(scores: Scores, path: Path) -> None:
    """Write the expectations, replacing the file whole.

    One entry per episode: trace hash, success and its time, and per assigned rule verdict, time,
    signal, value, limit (SI) and the digest of the rule.

    Raises:
        InputError: an episode could not be judged, or the file cannot be written.
    """
    if scores.problems:
        raise InputError(
            str(path),
            f"not written: {len(scores.problems)} episodes could not be judged.",
            fix=scores.problems[0].message,
        )
    results = sorted(scores.results, key=lambda r: r.episode_id)
    table = {"format": FORMAT, "episodes": {r.episode_id: _expected(r) for r in results}}
    temporary = path.with_name(path.name + ".tmp")
    try:
        temporary.write_text(json.dumps(table, indent=1, ensure_ascii=False) + "\n", "utf-8")
        temporary.replace(path)
    except OSError as error:
        raise InputError(str(path), f"cannot be written: {error.strerror}.") from None


def compare_golden(scores: Scores, path: Path) -> list[str]:
    """What differs, one line each; empty when everything is as expected.

    Raises:
        InputError: the file is not there or is no golden file.
    """
    wanted = _read(path)
    found = {r.episode_id: r for r in scores.results}
    lines = [
        f"{name}: expected, but not among the episodes" for name in wanted if name not in found
    ]
    missing = Counter(
        rule
        for name, r in found.items()
        for rule in r.not_loaded
        if rule in wanted.get(name, {}).get("rules", {})
    )
    lines += [
        f"{rule}: not among the loaded rules, so not judged in {number} episodes"
        for rule, number in sorted(missing.items())
    ]
    for name, result in found.items():
        if name in wanted:
            lines += [f"{name}: {line}" for line in _differences(wanted[name], result)]
        else:
            lines.append(f"{name}: not expected; --update-golden adds it")
    return lines


def _read(path: Path) -> dict[str, Any]:
    try:
        table = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(
            str(path), f"cannot be read: {error.strerror}.", fix="write it with --update-golden"
        ) from None
    except ValueError:
        table = None
    if not _is_golden(table):
        raise InputError(str(path), "not a golden file.", "JSON written by --update-golden")
    episodes: dict[str, Any] = table["episodes"]
    return episodes


def _is_golden(table: Any) -> bool:
    """Whether it is built as ``write_golden`` builds it."""

    def holds(value: Any, *names: str) -> bool:
        return isinstance(value, dict) and value.keys() >= {*names}

    return (
        holds(table, "format", "episodes")
        and table["format"] == FORMAT
        and holds(table["episodes"])
        and all(
            holds(episode, "trace_hash", "success", "success_time", "rules")
            and holds(episode["rules"])
            and all(holds(rule, *_FIELDS, "rule_digest") for rule in episode["rules"].values())
            for episode in table["episodes"].values()
        )
    )


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
    other_trace = wanted["trace_hash"] != found["trace_hash"]
    if other_trace:
        lines.append("the trace is not the one that the expectations were made for")
    lines += [
        f"{name} {_shown(name, wanted[name])} → {_shown(name, found[name])}"
        for name in ("success", "success_time")
        if not _same(name, wanted[name], found[name])
    ]
    verdicts = {v.rule: v for v in result.assigned}
    for rule in sorted({*wanted["rules"], *verdicts} - {*result.not_loaded}):
        if rule not in verdicts or rule not in wanted["rules"]:
            what = "is not assigned any more" if rule in wanted["rules"] else "was not assigned"
            lines.append(f"{rule}: {what}")
        else:
            line = _change(wanted["rules"][rule], verdicts[rule], other_trace=other_trace)
            lines += [f"{rule}: {line}"] if line else []
    return lines


def _change(before: dict[str, Any], v: Verdict, *, other_trace: bool) -> str:
    """What changed in a verdict and for which of three reasons; empty if nothing did."""
    now = _verdict(v)
    changes = [
        f"{name} {_shown(name, before[name], v.dimension)} → {_shown(name, now[name], v.dimension)}"
        for name in _FIELDS
        if not _same(name, before[name], now[name])
    ]
    if not changes:
        return ""
    reasons = [
        reason
        for reason, is_so in (
            ("the trace is another", other_trace),
            ("the rule means something else", before["rule_digest"] != now["rule_digest"]),
        )
        if is_so
    ]
    why = " and ".join(reasons) or "trace and rule are the same: the evaluator has changed"
    return f"{', '.join(changes)} ({why})"


def _same(name: str, before: Any, now: Any) -> bool:
    if isinstance(before, bool) or isinstance(now, bool):
        return before is now
    if isinstance(before, int | float) and isinstance(now, int | float):
        if name.endswith("time"):
            return abs(before - now) <= FRAME + 1e-6
        return math.isclose(before, now, rel_tol=VALUE_TOLERANCE, abs_tol=LEAST_TOLERANCE)
    return bool(before == now)


def _rounded(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, 6)


def _shown(name: str, value: Any, dimension: str | None = None) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    return f"{value:.3f} s" if name.endswith("time") else format_quantity(value, dimension or "")
