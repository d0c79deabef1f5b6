"""The rule language once more, as slowly and plainly as possible: an oracle for the fast one.

Works frame by frame on Python lists, from the definitions in docs/meanings.md and docs/rules.md
alone; shares no code with the evaluator. Margins are plain numbers here, one per frame, and all is
known. A rule is given as plain data:

    scope: a function (signals, frames) → list of (first, stop) half-open stretches
    kind:  "require", "forbid" or "reach"
    what:  margin per frame
    until: truth per frame, or None
    lasting: how many frames without a break (for)
"""

from __future__ import annotations

import math
from collections.abc import Sequence

Margins = Sequence[float]
Truths = Sequence[bool]
Stretch = tuple[int, int]


# ---- conditions


def above(values: Sequence[float], limit: float) -> list[float]:
    """``>= limit``."""
    return [v - limit for v in values]


def below(values: Sequence[float], limit: float) -> list[float]:
    """``<= limit``."""
    return [limit - v for v in values]


def both(a: Margins, b: Margins) -> list[float]:
    return [min(x, y) for x, y in zip(a, b, strict=True)]


def either(a: Margins, b: Margins) -> list[float]:
    return [max(x, y) for x, y in zip(a, b, strict=True)]


def truth(margin: Margins) -> list[bool]:
    return [m >= 0 for m in margin]


# ---- states


def lasting_state(
    values: Truths, lasting: int = 1, gap: int = 0, until: Truths | None = None
) -> list[bool]:
    """Gaps of at most ``gap`` are closed, then runs shorter than ``lasting`` dropped, then latched."""
    out = list(values)
    for first, stop in stretches([not v for v in values]):
        inner = first > 0 and stop < len(values)
        if inner and stop - first <= gap:
            for i in range(first, stop):
                out[i] = True
    for first, stop in stretches(out):
        if stop - first < lasting:
            for i in range(first, stop):
                out[i] = False
    if until is None:
        return out
    latched, on = [], False
    for value, reset in zip(out, until, strict=True):
        on = (on or value) and not reset
        latched.append(on)
    return latched


def stretches(values: Truths) -> list[Stretch]:
    """Runs of True."""
    out, begin = [], None
    for i, value in enumerate([*values, False]):
        if value and begin is None:
            begin = i
        if not value and begin is not None:
            out.append((begin, i))
            begin = None
    return out


# ---- moments and spans


def starts(values: Truths) -> list[int]:
    return [i for i in range(len(values)) if values[i] and (i == 0 or not values[i - 1])]


def ends(values: Truths) -> list[int]:
    return [i for i in range(1, len(values)) if values[i - 1] and not values[i]]


def from_to(on: Truths, off: Truths) -> list[Stretch]:
    """From each frame of ``on`` to the next of ``off``; empty, but there, where both are at once."""
    out, begin = [], None
    for i in range(len(on)):
        if begin is None and on[i]:
            begin = i
        if begin is not None and off[i]:
            out.append((begin, i))
            begin = None
    if begin is not None:
        out.append((begin, len(on)))
    return out


def after(moments: Sequence[int], frames: int, total: int) -> list[Stretch]:
    return [(m, min(m + frames, total)) for m in moments]


def before(moments: Sequence[int], frames: int) -> list[Stretch]:
    return [(max(0, m - frames), m) for m in moments]


def first_of(spans: Sequence[Stretch], frames: int) -> list[Stretch]:
    return [(a, min(a + frames, b)) for a, b in spans]


def last_of(spans: Sequence[Stretch], frames: int) -> list[Stretch]:
    return [(max(a, b - frames), b) for a, b in spans]


def within(spans: Sequence[Stretch], values: Truths) -> list[Stretch]:
    out = []
    for a, b in spans:
        out += [(a + i, a + j) for i, j in stretches(values[a:b])]
    return out


# ---- obligations


def require(margin: Margins) -> float:
    """The worst frame; nothing to judge is no violation."""
    worst = math.inf
    for m in margin:
        worst = min(worst, m)
    return worst


def reach(margin: Margins, lasting: int = 1) -> float:
    """The best stretch of so many frames, each stretch as good as its worst frame."""
    best = -math.inf
    for i in range(len(margin) - lasting + 1):
        best = max(best, min(margin[i : i + lasting]))
    return best


def forbid(margin: Margins, lasting: int = 1) -> float:
    """The opposite; a margin of exactly 0 is the thing itself, and so a violation."""
    return -reach(margin, lasting)


def judge(
    kind: str,
    what: Margins,
    spans: Sequence[Stretch],
    until: Truths | None = None,
    lasting: int = 1,
) -> tuple[str, float, int]:
    """Verdict, worst margin over all stretches (normalised by nothing), number of stretches."""
    worst, violated, decide = (
        math.inf,
        False,
        {"require": require, "forbid": forbid, "reach": reach},
    )
    for first, stop in spans:
        if until is not None:
            for i in range(first, stop):
                if until[i]:
                    stop = i  # noqa: PLW2901
                    break
        inside = what[first:stop]
        margin = decide[kind](inside) if kind == "require" else decide[kind](inside, lasting)
        broken = margin <= 0 if kind == "forbid" else margin < 0
        violated |= broken
        worst = min(worst, margin)
    return "violation" if violated else "pass", worst, len(spans)


def charged(values: Truths, spans: Sequence[Stretch], per: str, dt: float) -> float:
    """Value of a charge of 1."""
    inside = [False] * len(values)
    for first, stop in spans:
        for i in range(first, stop):
            inside[i] = True
    if per == "start":
        return sum(inside[i] for i in starts(values))
    return sum(
        (dt if per == "second" else 1) for v, i in zip(values, inside, strict=True) if v and i
    )
