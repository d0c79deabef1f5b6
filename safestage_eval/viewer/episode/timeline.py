"""A verdict's evidence over time: measurements with their limits, states, intervals in violation."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from safestage_eval.units import format_quantity, in_unit, unit_of
from safestage_eval.verdicts import Verdict
from safestage_eval.verdicts.curves import Bound, Curve, Lane, Looked

from .svg import Scale, drawing, line, short, text, tick_text, ticks

F64 = NDArray[np.float64]

WIDTH, LEFT, RIGHT = 640.0, 52.0, 12.0
PANEL, GAP, LANE = 96.0, 34.0, 17.0
COLUMNS = 280
"""Into so many pieces time is cut; of each the least and the greatest value are drawn."""

CURVES = 3
"""Measurements that are drawn; the decisive one is the first of them."""


def timeline(t: F64, looked: Looked, verdict: Verdict, success: float | None) -> str:
    """Draw panels over one axis of time.

    Args:
        t: (T,) s.
        looked: the measurements of the rule.
        verdict: of the rule.
        success: s, the moment of native success; None if there was none.
    """
    curves, lanes = looked.curves[:CURVES], looked.lanes[:6]
    across = Scale(float(t[0]), float(t[-1]), LEFT, WIDTH - RIGHT)
    top, parts, panels = 32.0, [], []  # moments are named above, at 10
    for curve in curves:
        panels.append((curve, top))
        top += PANEL + GAP
    lanes_top = top - (GAP - 18 if curves else 0)
    bottom = lanes_top + LANE * (len(lanes) + 1)
    for a, b in verdict.intervals:
        x, width = across(a), max(across(b) - across(a), 1.5)
        parts.append(
            f'<rect class="bad" x="{short(x)}" y="14" width="{short(width)}"'
            f' height="{short(bottom - 14)}"><title>in violation from {a:.2f} s to {b:.2f} s</title></rect>'
        )
    for curve, y in panels:
        parts.append(_panel(t, curve, across, y))
    y = lanes_top
    for lane in lanes:
        parts.append(_lane(t, lane, across, y))
        y += LANE
    parts.append(_bar(t, "judged", [*looked.judged], across, y, "judged"))
    parts += _moments(verdict, success, across, bottom)
    parts += _axis(across, bottom)
    names = ", ".join(curve.signal for curve in curves) or "states"
    title = f"{names} over {t[-1] - t[0]:.1f} s"
    return drawing(WIDTH, bottom + 30, title, parts, css="timeline", desc=verdict.explanation)


def _panel(t: F64, curve: Curve, across: Scale, top: float) -> str:
    dimension = curve.series.dimension
    lower, upper = curve.series.lower, curve.series.upper
    at_least = np.isfinite(lower) & ~np.isfinite(upper)
    shown = curve.series.value * in_unit(1.0, dimension)
    bounds = [in_unit(b.value, dimension) for b in curve.limits]
    finite = shown[np.isfinite(shown)]
    low = min([*bounds, finite.min() if len(finite) else 0.0])
    high = max([*bounds, finite.max() if len(finite) else 1.0])
    pad = 0.06 * (high - low) or max(abs(high), 1.0) * 0.1
    low = low if low == 0 else low - pad
    up = Scale(low, high + pad, top + PANEL, top)
    unit = unit_of(dimension)
    parts = [text(LEFT, top - 6, f"{curve.signal}{f' ({unit})' if unit else ''}", css="signal")]
    for tick in ticks(up.low, up.high, 3):
        parts += [
            line(LEFT, up(tick), WIDTH - RIGHT, up(tick), "grid"),
            text(LEFT - 6, up(tick) + 4, tick_text(tick), anchor="end", css="tick soft"),
        ]
    for bound, value in zip(curve.limits, bounds, strict=True):
        parts.append(_limit(bound, value, dimension, up))
    for css, mask in (("curve", np.isfinite(shown) & ~at_least), ("curve least", at_least)):
        path = _path(t, shown, mask, across, up)
        if path:
            parts.append(f'<path class="{css}" d="{path}"/>')
    return "".join(parts)


def _limit(bound: Bound, value: float, dimension: str, up: Scale) -> str:
    y, bad = up(value), up.stop if bound.bad == "above" else up.start
    said = f"limit {format_quantity(bound.value, dimension)}"
    if bound.param:
        said = f"{bound.param} {format_quantity(bound.value, dimension)}"
    side = y - 4 if bound.bad == "above" else y + 12
    return (
        f'<rect class="beyond" x="{short(LEFT)}" y="{short(min(y, bad))}"'
        f' width="{short(WIDTH - RIGHT - LEFT)}" height="{short(abs(bad - y))}"/>'
        + line(LEFT, y, WIDTH - RIGHT, y, "limit")
        + text(WIDTH - RIGHT - 4, side, said, anchor="end", css="limit-name")
    )


def _path(t: F64, values: F64, mask: NDArray[np.bool_], across: Scale, up: Scale) -> str:
    """Least and greatest value of each column, in their order; broken where nothing was measured.

    Frames that were not measured, between others that were, do not break it.
    """
    measured = np.flatnonzero(mask)
    if not len(measured):
        return ""
    column = ((t[measured] - t[0]) / max(t[-1] - t[0], 1e-9) * (COLUMNS - 1)).astype(int)
    unknown = np.flatnonzero(~mask)
    out: list[tuple[str, str, str]] = []
    last = None
    for frame in _ends(column, measured, values):
        x, y = across(float(t[frame])), up(float(values[frame]))
        gap = last is None or _broken(unknown, last, frame, len(t))
        out.append(("M" if gap else "L", short(x), short(y)))
        last = frame
    kept = [
        point
        for i, point in enumerate(out)
        if not (
            0 < i < len(out) - 1
            and point[0] == "L"
            and out[i + 1][0] == "L"
            and out[i - 1][2] == point[2] == out[i + 1][2]
        )
    ]
    return "".join(f"{pen}{x} {y}" for pen, x, y in kept)


def _ends(column: NDArray[np.int_], measured: NDArray[np.int_], values: F64) -> list[int]:
    """The frames with the least and the greatest value of each column, in order."""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(column)) + 1])
    group = np.repeat(np.arange(len(starts)), np.diff([*starts, len(column)]))
    picked = []
    for extreme in (np.minimum, np.maximum):
        there = values[measured] == extreme.reduceat(values[measured], starts)[group]
        _, first = np.unique(group[there], return_index=True)
        picked.append(measured[there][first])
    return [int(frame) for frame in np.unique(np.concatenate(picked))]


def _broken(unknown: NDArray[np.int_], last: int, frame: int, frames: int) -> bool:
    """More frames in a row are unknown than thinning out leaves between two."""
    between = np.searchsorted(unknown, frame) - np.searchsorted(unknown, last)
    return bool(between > 2 * frames / 240 + 2)


def _lane(t: F64, lane: Lane, across: Scale, y: float) -> str:
    parts = [_bar(t, lane.name, _runs(lane.true), across, y, "lane")]
    for a, b in _runs(~lane.known):
        parts.append(_block(t, a, b, across, y, "unknown", f"{lane.name} is not known"))
    return "".join(parts)


def _bar(
    t: F64, name: str, runs: Sequence[tuple[int, int]], across: Scale, y: float, css: str
) -> str:
    parts = [line(LEFT, y + 8, WIDTH - RIGHT, y + 8, "rail")]
    for a, b in runs:
        parts.append(_block(t, a, b, across, y, css, name))
    return "".join([*parts, text(LEFT + 4, y + 6, name, css="lane-name")])


def _block(t: F64, a: int, b: int, across: Scale, y: float, css: str, name: str) -> str:
    begin, end = float(t[min(a, len(t) - 1)]), float(t[min(b, len(t)) - 1])
    width = max(across(end) - across(begin), 1.0)
    said = escape(f"{name}: {begin:.2f} s to {end:.2f} s")
    return (
        f'<rect class="{css}" x="{short(across(begin))}" y="{short(y + 8)}"'
        f' width="{short(width)}" height="5" rx="2"><title>{said}</title></rect>'
    )


def _runs(true: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], true, [False]]).astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def _moments(verdict: Verdict, success: float | None, across: Scale, bottom: float) -> list[str]:
    moments = []
    if success is not None:
        moments.append((success, "success", "success"))
    if verdict.worst_time is not None:
        name = "worst" if verdict.verdict == "violation" else "closest"
        moments.append((verdict.worst_time, name, "worst"))
    parts: list[str] = []
    taken: list[tuple[float, float]] = []
    for time, name, css in sorted(moments):
        x, said = across(time), f"{name} {time:.2f} s"
        wide = 6.0 * len(said)
        spots = [(x + 4, x + 4 + wide, "start"), (x - 4 - wide, x - 4, "end")]
        free = [s for s in spots if _fits(s, taken)] or [(*spots[x > WIDTH / 2][:2], "below")]
        left, right, anchor = free[0]
        y = 10.0
        if anchor == "below":
            y, anchor = bottom + 27, "end" if x > WIDTH / 2 else "start"
        else:
            taken.append((left, right))
        parts.append(line(x, 14, x, bottom, f"moment {css}"))
        parts.append(
            text(x + (-4 if anchor == "end" else 4), y, said, anchor=anchor, css=f"said {css}")
        )
    return parts


def _fits(spot: tuple[float, float, str], taken: Sequence[tuple[float, float]]) -> bool:
    left, right, _ = spot
    return left >= LEFT and right <= WIDTH and all(right < a or left > b for a, b in taken)


def _axis(across: Scale, y: float) -> list[str]:
    parts = [line(LEFT, y, WIDTH - RIGHT, y, "axis")]
    for tick in ticks(across.low, across.high, 8):
        parts += [
            line(across(tick), y, across(tick), y + 4, "axis"),
            text(across(tick), y + 15, f"{tick_text(tick)} s", anchor="middle", css="tick soft"),
        ]
    return parts
