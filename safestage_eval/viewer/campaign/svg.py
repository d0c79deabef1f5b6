"""Elements of SVG drawings: numbers, ticks, scales, marks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

SHAPES = ("circle", "square", "triangle", "diamond")
"""Marks that can be distinguished without colours."""


def short(value: float, digits: int = 1) -> str:
    """Write a coordinate with no more characters than it needs."""
    text = f"{value:.{digits}f}"
    if "." in text:
        text = text.rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def ticks(low: float, high: float, about: int = 4) -> list[float]:
    """Choose round numbers from ``low`` to ``high``, about ``about`` of them."""
    span = high - low
    if not span > 0 or not math.isfinite(span):
        return [low]
    step = 10 ** math.floor(math.log10(span / about))
    step *= min((m for m in (1, 2, 5, 10) if span / (step * m) <= about + 0.5), default=10)
    first = math.ceil(low / step - 1e-9)
    return [step * i for i in range(first, math.floor(high / step + 1e-9) + 1)]


def tick_text(value: float) -> str:
    """Write the label of a tick."""
    return f"{value:.6g}".replace("-", "−")


@dataclass(frozen=True)
class Scale:
    """Values [low, high] onto coordinates [start, stop]."""

    low: float
    high: float
    start: float
    stop: float

    def __call__(self, value: float) -> float:
        """The coordinate of a value; values beyond the ends are drawn at the ends."""
        span = self.high - self.low
        part = (min(max(value, self.low), self.high) - self.low) / span if span else 0.5
        return self.start + part * (self.stop - self.start)


def mark(shape: str, x: float, y: float, size: float, css: str, title: str = "") -> str:
    """One mark of ``SHAPES`` with its centre at (x, y)."""
    said = f"<title>{escape(title)}</title>" if title else ""
    if shape == "circle":
        return f'<circle class="{css}" cx="{short(x)}" cy="{short(y)}" r="{short(size)}">{said}</circle>'
    s = size
    points = {
        "square": [(-s, -s), (s, -s), (s, s), (-s, s)],
        "triangle": [(0, -1.2 * s), (1.15 * s, 0.9 * s), (-1.15 * s, 0.9 * s)],
        "diamond": [(0, -1.3 * s), (1.3 * s, 0), (0, 1.3 * s), (-1.3 * s, 0)],
    }[shape]
    at = " ".join(f"{short(x + dx)},{short(y + dy)}" for dx, dy in points)
    return f'<polygon class="{css}" points="{at}">{said}</polygon>'


def text(
    x: float, y: float, said: str, *, anchor: str = "start", css: str = "", more: str = ""
) -> str:
    """A line of text; ``more`` are further attributes."""
    return (
        f'<text x="{short(x)}" y="{short(y)}"'
        + (f' text-anchor="{anchor}"' if anchor != "start" else "")
        + (f' class="{css}"' if css else "")
        + (f" {more}" if more else "")
        + f">{escape(said)}</text>"
    )


def line(x1: float, y1: float, x2: float, y2: float, css: str) -> str:
    """A straight line."""
    return (
        f'<line class="{css}" x1="{short(x1)}" y1="{short(y1)}" x2="{short(x2)}" y2="{short(y2)}"/>'
    )


def drawing(
    width: float, height: float, title: str, parts: Sequence[str], *, css: str = "", desc: str = ""
) -> str:
    """Write the ``<svg>`` element: as wide as its place allows, with a title that is read out."""
    return (
        f'<svg class="{css}" viewBox="0 0 {short(width)} {short(height)}" role="img"'
        f' aria-label="{escape(title)}{escape(". " + desc if desc else "")}">'
        f"<title>{escape(title)}</title>{''.join(parts)}</svg>"
    )
