"""Expected verdicts, kept beside traces, and what differs from them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from safestage_eval._text.json_text import from_json
from safestage_eval._text.plural import count
from safestage_eval.errors import InputError
from safestage_eval.formats.atomic import write_output
from safestage_eval.run.gates import Gates
from safestage_eval.run.scores import Scores
from safestage_eval.signals import SIGNALS
from safestage_eval.units import format_quantity
from safestage_eval.verdicts import EpisodeResult

from .document import render_json

FORMAT = 1
UPDATE = "--update-golden"
FRAME = 1 / 120
"""s: times may differ by a frame, because rounding may push a value over its limit that much
sooner or later."""
VALUE_TOLERANCE = 1e-3
"""Relative; rounding of another machine, not another verdict."""
LEAST_TOLERANCE = 1e-4
"""Absolute, SI: 0.1 mm, 0.1 mrad, 0.1 mN."""

_FIELDS = ("verdict", "time", "signal", "value", "limit")


@dataclass(frozen=True)
class Change:
    """One thing that is not as expected.

    Attributes:
        what: what changed and why, in one line.
        episode_id: the episode; None if it concerns several.
        rule: the rule whose verdict changed; None if it concerns the whole episode.
    """

    what: str
    episode_id: str | None = None
    rule: str | None = None

    def __str__(self) -> str:
        """``episode: rule: what``."""
        return ": ".join(filter(None, (self.episode_id, self.rule, self.what)))


def write_golden(scores: Scores, path: Path) -> None:
    """Write the expectations, replacing the file whole.

    One entry per episode: trace hash, success and its time, and per rule that counts verdict, time,
    signal, value, limit (SI) and the digest of the rule.

    Raises:
        InputError: an episode could not be judged, or the file cannot be written.
    """
    if scores.problems:
        raise InputError(
            str(path),
            f"not written: {count(len(scores.problems), 'episode')} could not be judged.",
            fix=scores.problems[0].message,
        )
    results = sorted(scores.results, key=lambda r: r.episode_id)
    table = {
        "format": FORMAT,
        "episodes": {r.episode_id: _expected(r, scores.gates) for r in results},
    }
    try:
        write_output(path, render_json(table).encode())
    except OSError as error:
        raise InputError(str(path), f"cannot be written: {error.strerror}.") from None


def changes(scores: Scores, path: Path, update: str = UPDATE) -> list[Change]:
    """List the differences from the expectations; empty if there are none.

    ``update``: the option that rewrites the file, for messages.

    Raises:
        InputError: the file is not there or is no golden file.
    """
    wanted = _read(path, update)
    results = {r.episode_id: r for r in scores.results}
    found = [
        Change("expected, but not among the episodes", name)
        for name in wanted
        if name not in results
    ]
    missing = Counter(
        rule
        for name, r in results.items()
        for rule in r.not_loaded
        if rule in wanted.get(name, {}).get("rules", {})
    )
    for rule, number in sorted(missing.items()):
        episodes = count(number, "episode")
        found.append(Change(f"not among the loaded rules, so not judged in {episodes}", None, rule))
    for name, result in results.items():
        if name in wanted:
            found += _differences(wanted[name], result, scores.gates)
        else:
            found.append(Change(f"not expected; {update} adds it", name))
    return found


def _read(path: Path, update: str) -> dict[str, Any]:
    """Episode id → what is expected of it; the file has the structure that ``write_golden`` writes."""
    try:
        table = from_json(path.read_text(encoding="utf-8"))
        assert table["format"] == FORMAT
        episodes: dict[str, Any] = table["episodes"]
        for episode in episodes.values():
            assert episode.keys() >= {"trace_hash", "success", "success_time"}
            assert all(r.keys() >= {*_FIELDS, "rule_digest"} for r in episode["rules"].values())
    except OSError as error:
        fix = f"write it with {update}"
        raise InputError(str(path), f"cannot be read: {error.strerror}.", fix=fix) from None
    except (ValueError, LookupError, TypeError, AttributeError, AssertionError):
        raise InputError(str(path), "not a golden file.", f"JSON written by {update}") from None
    return episodes


def _expected(result: EpisodeResult, gates: Gates) -> dict[str, Any]:
    return {
        "trace_hash": result.trace_hash,
        "success": result.success,
        "success_time": _rounded(result.success_time),
        "rules": {
            v.rule: {name: _rounded(getattr(v, name)) for name in (*_FIELDS, "rule_digest")}
            for v in gates.counted(result)
        },
    }


def _differences(wanted: dict[str, Any], result: EpisodeResult, gates: Gates) -> Iterator[Change]:
    actual, name = _expected(result, gates), result.episode_id
    other_trace = wanted["trace_hash"] != actual["trace_hash"]
    if other_trace:
        hashes = _hashes(wanted["trace_hash"], actual["trace_hash"])
        yield Change(
            f"the trace is not the one that the expectations were made for: {hashes}", name
        )
    for field in ("success", "success_time"):
        before, now = wanted[field], actual[field]
        if not _same(field, before, now):
            yield Change(f"{field} {_shown(field, before)} → {_shown(field, now)}", name)
    dimensions = {v.rule: v.dimension for v in gates.counted(result)}
    before, now = wanted["rules"], actual["rules"]
    for rule in sorted({*before, *now} - {*result.not_loaded}):
        if rule not in now:
            yield Change("is not assigned or named any more", name, rule)
        elif rule not in before:
            yield Change("was not assigned or named", name, rule)
        elif what := _change(before[rule], now[rule], dimensions[rule], other_trace=other_trace):
            yield Change(what, name, rule)


def _change(
    before: dict[str, Any], now: dict[str, Any], dimension: str | None, *, other_trace: bool
) -> str:
    """Describe what changed in a verdict, and for which of three reasons; empty if nothing did.

    Value and limit are given even where they did not change: the verdict rests on them.
    """
    changed = [name for name in _FIELDS if not _same(name, before[name], now[name])]
    if not changed:
        return ""
    parts = []
    same_signal = before["signal"] == now["signal"]
    was = dimension if same_signal else _dimension(before["signal"])
    for name in _FIELDS:
        old, new = _shown(name, before[name], was), _shown(name, now[name], dimension)
        if name in changed or (old != new and not same_signal):
            parts.append(f"{name} {old} → {new}")
        elif name in ("value", "limit") and now[name] is not None:
            parts.append(f"{name} still {new}")
    reasons = ["the trace is another"] if other_trace else []
    if before["rule_digest"] != now["rule_digest"]:
        digests = _hashes(before["rule_digest"], now["rule_digest"])
        reasons.append(f"rule or parameter changed: digest {digests}")
    why = " and ".join(reasons) or "trace and rule are the same: the evaluator has changed"
    return f"{', '.join(parts)} ({why})"


def _dimension(signal: str | None) -> str | None:
    """Dimension of a signal by its name; None of other entries, such as when a state begins."""
    spec = SIGNALS.get((signal or "").partition("(")[0])
    return None if spec is None else spec.dimension


def _hashes(before: str, now: str) -> str:
    return f"{str(before)[:8]} → {now[:8]}"


def _same(name: str, before: Any, now: Any) -> bool:
    if isinstance(before, bool) or isinstance(now, bool):
        return before is now
    if isinstance(before, int | float) and isinstance(now, int | float):
        if name.endswith("time"):
            return abs(before - now) <= FRAME + 1e-6
        return math.isclose(before, now, rel_tol=VALUE_TOLERANCE, abs_tol=LEAST_TOLERANCE)
    return bool(before == now)


def _rounded(value: Any) -> Any:
    """A number to the sixth digit, None if it is not finite; anything else as it is."""
    if not isinstance(value, float):
        return value
    return round(value, 6) if math.isfinite(value) else None


def _shown(name: str, value: Any, dimension: str | None = None) -> str:
    if value is None:
        return "none"
    if isinstance(value, bool) or not isinstance(value, int | float):
        return str(value)
    if name.endswith("time"):
        return f"{value:.3f} s"
    return f"{value:g} (SI)" if dimension is None else format_quantity(value, dimension)
