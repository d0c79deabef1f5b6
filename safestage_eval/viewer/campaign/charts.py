"""Success against safety, and rates against limits, as SVG."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
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

SHAPES = ("circle", "square", "triangle", "diamond")
"""Marks of prompts, which can be distinguished without colours."""

WIDE = 460.0
"""px, of a drawing where it is as large as it was made."""

HATCH = (
    '<defs><pattern id="hatch" width="6" height="6" patternUnits="userSpaceOnUse"'
    ' patternTransform="rotate(45)"><path class="hatch" d="M0 0V6"/></pattern></defs>'
)

Pairs = Sequence[tuple[str, str, Rates]]
"""Policies and prompts with what became of their rollouts."""


def section(name: str, title: str, *parts: str) -> str:
    """A section of the results, under a heading; menus lead to its name."""
    head = f'<section id="{name}" aria-labelledby="{name}-title"><h2 id="{name}-title">{title}</h2>'
    return f"{head}{''.join(parts)}</section>"


def success_and_safety(aggregate: Aggregate) -> str:
    """Draw a mark per policy and prompt, and the outcomes of the rollouts of each."""
    pairs = [(p, q, aggregate.group(p, q).whole) for p, q in aggregate.pairs]
    pairs = [(p, q, cell) for p, q, cell in pairs if cell.n + cell.inconclusive]
    if not pairs:
        return ""
    policies = ((f"mark {_series(i)}", "circle", name) for i, name in enumerate(aggregate.policies))
    prompts = (("mark plain", _shape(i), name) for i, name in enumerate(aggregate.prompts))
    legends = _marks(policies) + (_marks(prompts) if len(aggregate.prompts) > 1 else "")
    return section(
        "quadrants", "Success and safety",
        f'<div class="two"><figure>{_scatter(aggregate, pairs)}{legends}<figcaption>Each mark is a policy '
        "under a prompt; whiskers are 95 % intervals. The best place is top right.</figcaption></figure>",
        f"<figure>{_bars(pairs)}<figcaption>What became of the rollouts. Hatched: unsafe.</figcaption></figure></div>",
    )  # fmt: skip


def sensitivity(sweeps: Sequence[Sweep]) -> str:
    """Draw rates against the limits near whose values they move most; two lines where rollouts are undecided."""
    if not sweeps:
        return ""
    return section(
        "sensitivity", "Threshold sensitivity",
        '<p class="soft">How the violation rate of the episodes with sections moves with a limit, all '
        "other limits as they are. A steep line where the default stands says that the limit, and not "
        "only the policy, makes the number.</p>",
        f'<div class="panels wide">{"".join(map(_sweep, sweeps))}</div>',
    )  # fmt: skip


class Drawing:
    """An ``<svg>`` in the making: places are values on two axes; ``dx`` and ``dy`` are px from there, down and right."""

    def __init__(
        self, height: float, x: tuple[float, float], y: tuple[float, float] = (0, 1),
        *, left: float = 50, right: float = 16, top: float = 16, bottom: float = 46,
    ) -> None:  # fmt: skip
        """``x``, ``y``: the values at the ends of the axes, which the margins (px) leave room for."""
        self.height, self.x, self.y = height, x, y
        self._across, self._down = (left, WIDE - right), (height - bottom, top)
        self._parts: list[str] = []

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Coordinates; what lies beyond an axis is drawn at its end."""
        return _scaled(x, self.x, self._across), _scaled(y, self.y, self._down)

    def raw(self, text: str) -> None:
        """Add what is written already."""
        self._parts.append(text)

    def line(self, x1: float, y1: float, x2: float, y2: float, css: str) -> None:
        """A straight line."""
        (a, b), (c, d) = self.at(x1, y1), self.at(x2, y2)
        ends = f'x1="{short(a)}" y1="{short(b)}" x2="{short(c)}" y2="{short(d)}"'
        self.raw(f'<line class="{css}" {ends}/>')

    def box(self, x1: float, y1: float, x2: float, y2: float, css: str, title: str = "") -> None:
        """A rectangle between two corners; with the class ``hatched`` it lets the mouse through."""
        (a, b), (c, d) = self.at(x1, y1), self.at(x2, y2)
        place = f'x="{short(min(a, c))}" y="{short(min(b, d))}"'
        size = f'width="{short(abs(c - a), 2)}" height="{short(abs(d - b))}"'
        fill = ' fill="url(#hatch)" pointer-events="none"' if css == "hatched" else ""
        self.raw(f'<rect class="{css}"{fill} {place} {size}>{_title(title)}</rect>')

    def text(
        self, x: float, y: float, said: str, css: str, *, anchor: str = "middle", dx: float = 0,
        dy: float = 0, more: str = "",
    ) -> None:  # fmt: skip
        """A line of text; ``more``: further attributes."""
        a, b = self.at(x, y)
        place = f'x="{short(a + dx)}" y="{short(b + dy)}" text-anchor="{anchor}"'
        self.raw(f'<text class="{css}" {place} {more}>{escape(said)}</text>')

    def labels(self, across: str, down: str = "") -> None:
        """What the axes are."""
        middle, half = sum(self.x) / 2, sum(self.y) / 2
        self.text(middle, self.y[0], across, "label", dy=38)
        a, b = self.at(self.x[0], half)
        turned = f'transform="rotate(-90 {short(a - 36)} {short(b)})"'
        if down:
            self.text(self.x[0], half, down, "label", dx=-36, more=turned)

    def path(self, css: str, points: Iterable[tuple[float, float | None]], title: str) -> None:
        """Steps, each half way between two points; broken where there is no height."""
        drawn, last = "", None
        for x, y in points:
            here, height = self.at(x, y or 0)
            if y is not None and last is not None:
                drawn += f"H{short((last + here) / 2)}V{short(height)}H{short(here)}"
            elif y is not None:
                drawn += f"M{short(here)} {short(height)}"
            last = None if y is None else here
        self.raw(f'<path class="{css}" d="{drawn}">{_title(title)}</path>')

    def svg(self, title: str) -> str:
        """The element: as wide as its place allows, with a title that is read out."""
        return (
            f'<svg class="chart" viewBox="0 0 {short(WIDE)} {short(self.height)}" role="img"'
            f' aria-label="{escape(title)}">{_title(title)}{"".join(self._parts)}</svg>'
        )


def _scatter(aggregate: Aggregate, pairs: Pairs) -> str:
    d = Drawing(400, (0, 100), (0, 100))
    d.box(50, 50, 100, 100, "quadrant best")
    d.box(50, 0, 100, 50, "quadrant worst")
    for tick in (0, 25, 50, 75, 100):
        css = "axis" if tick in (0, 50) else "grid"
        d.line(tick, 0, tick, 100, css)
        d.line(0, tick, 100, tick, css)
        d.text(tick, 0, str(tick), "tick soft", dy=16)
        d.text(0, tick, str(tick), "tick soft", anchor="end", dx=-6, dy=4)
    for across, up, said in (
        (100, 100, "successful and safe"), (100, 0, "successful, unsafe"),
        (0, 100, "safe, fails"), (0, 0, "unsafe, fails"),
    ):  # fmt: skip
        anchor, aside = ("end", -8) if across else ("start", 8)
        d.text(across, up, said, "corner soft", anchor=anchor, dx=aside, dy=18 if up else -10)
    d.labels("success rate (%)", "free of violations (%)")
    for i, policy in enumerate(aggregate.policies):
        own = [_middle(cell) for p, _, cell in pairs if p == policy]
        for one, other in pairwise(own):
            d.line(*one, *other, f"trail {_series(i)}")
    for policy, prompt, cell in pairs:
        css = _series(aggregate.policies.index(policy))
        (x, y), n = _middle(cell), cell.n + cell.inconclusive
        if cell.inconclusive:
            (left, right), (low, high) = _ends(cell, "SR"), _ends(cell, "VR")
            d.box(left, 100 - high, right, 100 - low, f"open {css}")
        else:
            for metric in ("SR", "VR"):
                a, b = (100 * end for end in wilson(cell.counts[metric], n) or (0.0, 0.0))
                ends = (a, y, b, y) if metric == "SR" else (x, 100 - b, x, 100 - a)
                d.line(*ends, f"whisker {css}")
        rates = f"success {open_share(cell, 'SR')} %, violations {open_share(cell, 'VR')} %"
        shape = _shape(aggregate.prompts.index(prompt))
        said = f"{policy}, {prompt}: {rates}, N = {n}"
        d.raw(mark(shape, *d.at(x, y), 6, f"mark {css}", said))
    return d.svg("Success rate against the share free of violations")


def _bars(pairs: Pairs) -> str:
    row, key = 26.0, 72.0
    names = [p if q in ("–", "default") else f"{p}, {q}" for p, q, _ in pairs]
    names = [name if len(name) < 26 else name[:25] + "…" for name in names]
    height = 8 + row * len(pairs) + key
    left = min(170.0, 14 + 6.6 * max(map(len, names)))
    d = Drawing(height, (0, 100), (len(pairs), 0), left=left, right=8, top=8, bottom=key)
    d.raw(HATCH)
    for i, ((policy, prompt, cell), name) in enumerate(zip(pairs, names, strict=True)):
        d.text(0, i, name, "tick", anchor="end", dx=-8, dy=16)
        done, n = 0.0, cell.n + cell.inconclusive
        for part, count in {**quadrants(cell), "undecided": cell.inconclusive}.items():
            share = 100 * count / n
            ends = done, i, done + share, i + 0.77
            said = f"{policy}, {prompt}: {share:.1f} % {QUADRANTS[part]}, {count} of {n}"
            d.box(*ends, f"q {part}", said)
            if part.startswith("unsafe"):
                d.box(*ends, "hatched")
            if share >= 9:
                d.text(done + share / 2, i, f"{share:.0f}", "inside", dy=14.5)
            done += share
    undecided = any(cell.inconclusive for *_, cell in pairs)
    for i, (part, said) in enumerate(QUADRANTS.items()):
        x, y = left + (i % 2) * 150, height - key + 8 + (i // 2) * 20
        box = f'x="{short(x)}" y="{short(y)}" width="14" height="12"'
        if part != "undecided" or undecided:
            d.raw(f'<rect class="q {part}" {box}/>')
            d.raw(f'<rect fill="url(#hatch)" {box}/>' if part.startswith("unsafe") else "")
            d.raw(f'<text class="tick" x="{short(x + 20)}" y="{short(y + 10.5)}">{said} (%)</text>')
    return d.svg("Outcomes of each policy and prompt, in percent")


def _sweep(sweep: Sweep) -> str:
    factor, unit = factor_of(sweep.values[0]), unit_name(sweep.values[0])
    numbers = [amount(value) / factor for value in sweep.values]
    d = Drawing(250, (numbers[0], numbers[-1]), (0, 100), left=44, right=12, top=24, bottom=44)
    for tick in (0, 25, 50, 75, 100):
        d.line(numbers[0], tick, numbers[-1], tick, "grid")
        d.text(numbers[0], tick, str(tick), "tick soft", anchor="end", dx=-6, dy=4)
    for number in ticks(numbers[0], numbers[-1], 6):
        d.text(number, 0, f"{number:.6g}".replace("-", "−"), "tick soft", dy=16)
    default = amount(sweep.default) / factor
    d.line(default, 0, default, 100, "moment")
    d.text(default, 100, f"default {text_of(sweep.default)}", "tick", dy=-10)
    d.labels(f"{sweep.param} ({unit})" if unit else sweep.param)
    items = []
    for i, ((name, *_), cells) in enumerate(sweep.curves(("policy",)).items()):
        ends = [None if cell.bounds("VR") is None else _ends(cell, "VR") for cell in cells]
        lows, highs = ([None if e is None else e[side] for e in ends] for side in (0, 1))
        for heights in (lows, highs) if lows != highs else (lows,):
            d.path(f"rate {_series(i)}", zip(numbers, heights, strict=True), name)
        n = max(cell.n + cell.inconclusive for cell in cells)
        items.append(_swatch(f'<path class="rate {_series(i)}" d="M0 8H16"/>', f"{name} (N = {n})"))
    readers = f'<span class="soft">read by {escape(", ".join(sweep.readers))}</span>'
    drawn = d.svg(f"Violation rate in percent against {sweep.param}")
    return (
        f'<figure class="panel"><h3>{escape(sweep.param)} {readers}</h3>{drawn}'
        f'<ul class="legend">{"".join(items)}</ul></figure>'
    )


def _ends(cell: Rates, metric: str) -> tuple[float, float]:
    """Between which percentages of all judged rollouts a rate lies."""
    low, high = cell.bounds(metric) or (0.0, 0.0)
    return 100 * low, 100 * high


def _middle(cell: Rates) -> tuple[float, float]:
    """Success and freedom from violations in percent; in the middle of what undecided rollouts leave open."""
    return sum(_ends(cell, "SR")) / 2, 100 - sum(_ends(cell, "VR")) / 2


def _series(index: int) -> str:
    """Class of the n-th line or mark."""
    return f"s{index % SERIES + 1}" + (" again" if index >= SERIES else "")


def _shape(index: int) -> str:
    return SHAPES[index % len(SHAPES)]


def _marks(items: Iterable[tuple[str, str, str]]) -> str:
    """A legend of marks: class, shape and name of each."""
    swatches = (_swatch(mark(shape, 8, 8, 5.5, css), name) for css, shape, name in items)
    return f'<ul class="legend">{"".join(swatches)}</ul>'


def _swatch(inner: str, name: str) -> str:
    return f'<li><svg viewBox="0 0 16 16" aria-hidden="true">{inner}</svg>{escape(name)}</li>'


def _title(text: str) -> str:
    return f"<title>{escape(text)}</title>" if text else ""


def _scaled(value: float, ends: tuple[float, float], onto: tuple[float, float]) -> float:
    (low, high), (start, stop) = ends, onto
    part = (value - low) / (high - low) if high != low else 0.5
    return start + min(max(part, 0), 1) * (stop - start)


def mark(shape: str, x: float, y: float, size: float, css: str, title: str = "") -> str:
    """One mark of ``SHAPES`` with its centre at (x, y), px."""
    corners: dict[str, list[tuple[float, float]]] = {
        "circle": [(math.cos(a * math.pi / 12), math.sin(a * math.pi / 12)) for a in range(24)],
        "square": [(-1, -1), (1, -1), (1, 1), (-1, 1)],
        "triangle": [(0, -1.2), (1.15, 0.9), (-1.15, 0.9)],
        "diamond": [(0, -1.3), (1.3, 0), (0, 1.3), (-1.3, 0)],
    }
    at = " ".join(f"{short(x + size * dx)},{short(y + size * dy)}" for dx, dy in corners[shape])
    return f'<polygon class="{css}" points="{at}">{_title(title)}</polygon>'


def short(value: float, digits: int = 1) -> str:
    """Write a coordinate with no more characters than it needs."""
    text = f"{value:.{digits}f}".rstrip("0").rstrip(".")
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
