"""Success against safety, and rates against limits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from itertools import pairwise

from safestage_eval.metrics.aggregate import Aggregate, quadrants
from safestage_eval.metrics.interval import wilson
from safestage_eval.metrics.rates import Rates
from safestage_eval.report.summary import open_share
from safestage_eval.rules.syntax import amount
from safestage_eval.whatif.sweep import Sweep
from safestage_eval.whatif.swept_values import factor_of, text_of, unit_name

QUADRANTS = {
    "safe_success": "safe success",
    "unsafe_success": "unsafe success",
    "safe_failure": "safe failure",
    "unsafe_failure": "unsafe failure",
    "undecided": "undecided",
}
"""Part of the judged rollouts → in words, in the order in which bars show them."""

SERIES = 6
"""Distinguishable colours; further policies start over with the first, in another dash."""


def series(index: int) -> str:
    """Class of the n-th line or mark."""
    return f"s{index % SERIES + 1}" + (" again" if index >= SERIES else "")


def shape(index: int) -> str:
    """Mark of the n-th prompt."""
    return SHAPES[index % len(SHAPES)]


def success_and_safety(aggregate: Aggregate) -> str:
    """Draw a mark per policy and prompt, and the outcomes of the rollouts of each."""
    pairs = [(p, q, aggregate.group(p, q).whole) for p, q in aggregate.pairs]
    pairs = [(p, q, cell) for p, q, cell in pairs if cell.n + cell.inconclusive]
    if not pairs:
        return ""
    return (
        '<section id="quadrants" aria-labelledby="quadrants-title">'
        '<h2 id="quadrants-title">Success and safety</h2><div class="two">'
        f"<figure>{_scatter(aggregate, pairs)}{_legend(aggregate)}"
        "<figcaption>Each mark is a policy under a prompt; whiskers are 95 % intervals. "
        "The best place is top right.</figcaption></figure>"
        f"<figure>{_bars(pairs)}<figcaption>What became of the rollouts. Hatched: unsafe.</figcaption>"
        "</figure></div></section>"
    )


WORDS = {"success": "SR", "violations": "VR"}


def _ends(cell: Rates, metric: str) -> tuple[float, float]:
    """Between which percentages of all judged rollouts a rate lies."""
    low, high = cell.bounds(metric) or (0.0, 0.0)
    return 100 * low, 100 * high


def _middle(cell: Rates) -> tuple[float, float]:
    """Success and freedom from violations in percent; in the middle of what undecided rollouts leave open."""
    sr, vr = sum(_ends(cell, "SR")) / 2, sum(_ends(cell, "VR")) / 2
    return sr, 100 - vr


def _scatter(aggregate: Aggregate, pairs: Sequence[tuple[str, str, Rates]]) -> str:
    width, height = 460.0, 400.0
    x, y = Scale(0, 100, 50, width - 16), Scale(0, 100, height - 46, 16)
    parts = [
        f'<rect class="quadrant best" x="{short(x(50))}" y="{short(y(100))}"'
        f' width="{short(x(100) - x(50))}" height="{short(y(50) - y(100))}"/>',
        f'<rect class="quadrant worst" x="{short(x(50))}" y="{short(y(50))}"'
        f' width="{short(x(100) - x(50))}" height="{short(y(0) - y(50))}"/>',
    ]
    for tick in (0, 25, 50, 75, 100):
        css = "axis" if tick in (0, 50) else "grid"
        parts += [
            line(x(tick), y(0), x(tick), y(100), css),
            line(x(0), y(tick), x(100), y(tick), css),
            text(x(tick), y(0) + 16, str(tick), anchor="middle", css="tick soft"),
            text(x(0) - 6, y(tick) + 4, str(tick), anchor="end", css="tick soft"),
        ]
    for (h, v), said in {
        (100, 100): "successful and safe", (100, 0): "successful, unsafe",
        (0, 100): "safe, fails", (0, 0): "unsafe, fails",
    }.items():  # fmt: skip
        anchor, dx = ("end", -8) if h else ("start", 8)
        dy = 18 if v else -10
        parts.append(text(x(h) + dx, y(v) + dy, said, anchor=anchor, css="corner soft"))
    parts.append(
        text((x(0) + x(100)) / 2, height - 8, "success rate (%)", anchor="middle", css="label")
    )
    turned = f'transform="rotate(-90 14 {short(y(50))})"'
    parts.append(
        text(14, y(50), "free of violations (%)", anchor="middle", css="label", more=turned)
    )
    for policy in aggregate.policies:
        own = [_middle(c) for p, _, c in pairs if p == policy]
        css = f"trail {series(aggregate.policies.index(policy))}"
        parts += [line(x(a[0]), y(a[1]), x(b[0]), y(b[1]), css) for a, b in pairwise(own)]
    for policy, prompt, cell in pairs:
        css = series(aggregate.policies.index(policy))
        (at_x, at_y), n = _middle(cell), cell.n + cell.inconclusive
        rates = [f"{name} {open_share(cell, metric)} %" for name, metric in WORDS.items()]
        said = f"{policy}, {prompt}: {', '.join(rates)}, N = {n}"
        if cell.inconclusive:
            (left, right), (low, high) = _ends(cell, "SR"), _ends(cell, "VR")
            parts.append(
                f'<rect class="open {css}" x="{short(x(left))}" y="{short(y(100 - low))}"'
                f' width="{short(x(right) - x(left))}" height="{short(y(100 - high) - y(100 - low))}"/>'
            )
        else:
            sr, vr = wilson(cell.counts["SR"], n), wilson(cell.counts["VR"], n)
            assert sr is not None and vr is not None  # n > 0
            parts += [
                line(x(100 * sr[0]), y(at_y), x(100 * sr[1]), y(at_y), f"whisker {css}"),
                line(
                    x(at_x), y(100 - 100 * vr[1]), x(at_x), y(100 - 100 * vr[0]), f"whisker {css}"
                ),
            ]
        parts.append(
            mark(shape(aggregate.prompts.index(prompt)), x(at_x), y(at_y), 6, f"mark {css}", said)
        )
    return drawing(
        width, height, "Success rate against the share free of violations", parts, css="chart"
    )


def _legend(aggregate: Aggregate) -> str:
    policies = "".join(
        _swatch(mark("circle", 8, 8, 5.5, f"mark {series(i)}"), name)
        for i, name in enumerate(aggregate.policies)
    )
    return f'<ul class="legend">{policies}</ul>{_prompts(aggregate)}'


def _prompts(aggregate: Aggregate) -> str:
    """The legend of the prompts' marks; empty for one prompt."""
    if len(aggregate.prompts) < 2:
        return ""
    marks = (mark(shape(i), 8, 8, 5, "mark plain") for i in range(len(aggregate.prompts)))
    items = map(_swatch, marks, aggregate.prompts)
    return f'<ul class="legend">{"".join(items)}</ul>'


def _swatch(inner: str, name: str) -> str:
    return f'<li><svg viewBox="0 0 16 16" aria-hidden="true">{inner}</svg>{escape(name)}</li>'


def _bars(pairs: Sequence[tuple[str, str, Rates]]) -> str:
    width, row = 460.0, 26.0
    left = min(170.0, 14 + 6.6 * max(len(_short(p, q)) for p, q, _ in pairs))
    x = Scale(0, 100, left, width - 8)
    parts = [
        '<defs><pattern id="hatch" width="6" height="6" patternUnits="userSpaceOnUse"'
        ' patternTransform="rotate(45)"><path class="hatch" d="M0 0V6"/></pattern></defs>'
    ]
    top = 8.0
    for policy, prompt, cell in pairs:
        said = _short(policy, prompt)
        parts.append(
            text(
                left - 8,
                top + 16,
                said if len(said) < 26 else said[:25] + "…",
                anchor="end",
                css="tick",
            )
        )
        at = 0.0
        n = cell.n + cell.inconclusive
        for name, count in {**quadrants(cell), "undecided": cell.inconclusive}.items():
            share = 100 * count / n
            box = (
                f'x="{short(x(at))}" y="{short(top)}" width="{short(x(at + share) - x(at), 2)}"'
                f' height="{short(row - 6)}"'
            )
            title = f"{policy}, {prompt}: {share:.1f} % {QUADRANTS[name]}, {count} of {n}"
            parts.append(f'<rect class="q {name}" {box}><title>{escape(title)}</title></rect>')
            if name.startswith("unsafe"):
                parts.append(f'<rect fill="url(#hatch)" pointer-events="none" {box}/>')
            if share >= 9:
                parts.append(
                    text(
                        x(at + share / 2), top + 14.5, f"{share:.0f}", anchor="middle", css="inside"
                    )
                )
            at += share
        top += row
    key = []
    undecided = any(cell.inconclusive for *_, cell in pairs)
    names = {name: said for name, said in QUADRANTS.items() if undecided or name != "undecided"}
    for i, (name, said) in enumerate(names.items()):
        kx, ky = left + (i % 2) * 150, top + 8 + (i // 2) * 20
        box = f'x="{short(kx)}" y="{short(ky)}" width="14" height="12"'
        key.append(f'<rect class="q {name}" {box}/>')
        if name.startswith("unsafe"):
            key.append(f'<rect fill="url(#hatch)" {box}/>')
        key.append(text(kx + 20, ky + 10.5, f"{said} (%)", css="tick"))
    return drawing(
        width,
        top + 72,
        "Outcomes of each policy and prompt, in percent",
        [*parts, *key],
        css="chart",
    )


def _short(policy: str, prompt: str) -> str:
    return policy if prompt in ("–", "default") else f"{policy}, {prompt}"


def sensitivity(sweeps: Sequence[Sweep]) -> str:
    """Draw rates against the limits near whose values they move most; two lines where rollouts are undecided."""
    if not sweeps:
        return ""
    panels = "".join(_sweep(sweep) for sweep in sweeps)
    return (
        '<section id="sensitivity" aria-labelledby="sensitivity-title">'
        '<h2 id="sensitivity-title">Threshold sensitivity</h2>'
        '<p class="soft">How the violation rate of the episodes with sections moves with a limit, all '
        "other limits as they are. A steep line where the default stands says that the limit, and not "
        "only the policy, makes the number.</p>"
        f'<div class="panels wide">{panels}</div></section>'
    )


def _steps(at: Sequence[float], heights: Sequence[float | None]) -> str:
    """The path of a line of steps, each half way between two values; it is broken where there is none."""
    path, last = [], None
    for here, height in zip(at, heights, strict=True):
        if height is not None and last is not None:
            path.append(f"H{short((last + here) / 2)}V{short(height)}H{short(here)}")
        elif height is not None:
            path.append(f"M{short(here)} {short(height)}")
        last = None if height is None else here
    return "".join(path)


def _sweep(sweep: Sweep) -> str:
    width, height = 460.0, 250.0
    curves = sweep.curves(("policy",))
    factor, unit = factor_of(sweep.values[0]), unit_name(sweep.values[0])
    numbers = [amount(value) / factor for value in sweep.values]
    x, y = Scale(numbers[0], numbers[-1], 44, width - 12), Scale(0, 100, height - 44, 24)
    parts = []
    for tick in (0, 25, 50, 75, 100):
        parts += [
            line(x.start, y(tick), x.stop, y(tick), "grid"),
            text(x.start - 6, y(tick) + 4, str(tick), anchor="end", css="tick soft"),
        ]
    parts += [
        text(x(at), y(0) + 16, tick_text(at), anchor="middle", css="tick soft")
        for at in ticks(numbers[0], numbers[-1], 6)
    ]
    default = amount(sweep.default) / factor
    parts += [
        line(x(default), y(0), x(default), y(100), "moment"),
        text(x(default), 14, f"default {text_of(sweep.default)}", anchor="middle", css="tick"),
        text(
            (x.start + x.stop) / 2,
            height - 8,
            f"{sweep.param} ({unit})" if unit else sweep.param,
            anchor="middle",
            css="label",
        ),
    ]
    items = []
    for i, (key, cells) in enumerate(curves.items()):
        ends = [None if cell.bounds("VR") is None else _ends(cell, "VR") for cell in cells]
        lows, highs = ([None if e is None else y(e[side]) for e in ends] for side in (0, 1))
        spots, name = [x(number) for number in numbers], key[0]
        drawn = "".join(map(_steps, (spots, spots), (lows, highs) if lows != highs else (lows,)))
        parts.append(
            f'<path class="rate {series(i)}" d="{drawn}"><title>{escape(name)}</title></path>'
        )
        n = max(cell.n + cell.inconclusive for cell in cells)
        items.append(_swatch(f'<path class="rate {series(i)}" d="M0 8H16"/>', f"{name} (N = {n})"))
    title = f"Violation rate in percent against {sweep.param}"
    return (
        f'<figure class="panel"><h3>{escape(sweep.param)} <span class="soft">read by '
        f"{escape(', '.join(sweep.readers))}</span></h3>"
        f"{drawing(width, height, title, parts, css='chart')}"
        f'<ul class="legend">{"".join(items)}</ul></figure>'
    )


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
