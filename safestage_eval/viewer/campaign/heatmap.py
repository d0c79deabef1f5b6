"""Rates of every task under every policy and prompt, as a heat map."""

from __future__ import annotations

from collections import defaultdict
from html import escape
from urllib.parse import quote

from safestage_eval.metrics.aggregate import Aggregate
from safestage_eval.metrics.rates import STAGES, Rates
from safestage_eval.metrics.seeds import total

SHOWN = ("VR", "USR", "SSR", "SR")
"""Metrics that can be chosen; the first is shown at the beginning."""


def heatmap(aggregate: Aggregate) -> str:
    """A table with a row per task, the stages one after another, the worst tasks first."""
    cells: dict[tuple[str, str], dict[tuple[str, str], list[Rates]]] = defaultdict(
        lambda: defaultdict(list)
    )
    for (policy, prompt, stage, _, task, _), cell in aggregate.base.items():
        cells[stage, task or "–"][policy, prompt].append(cell)
    pairs = aggregate.pairs
    summed = {
        row: {pair: total(parts) for pair, parts in own.items()} for row, own in cells.items()
    }
    whole = {row: total(own.values()) for row, own in summed.items()}

    def order(row: tuple[str, str]) -> tuple[int, float, str]:
        stage = STAGES.index(row[0]) if row[0] in STAGES else len(STAGES)
        return stage, -(whole[row].bounds("VR") or (0.0,))[0], row[1]

    body, above = [], None
    for row in sorted(summed, key=order):
        stage, task = row
        if stage != above:
            body.append(
                f'<tr class="group"><th scope="rowgroup" colspan="{len(pairs) + 2}">{escape(stage)}</th></tr>'
            )
            above = stage
        data = "".join(
            _cell(summed[row].get(pair), task=task, policy=pair[0], prompt=pair[1])
            for pair in pairs
        )
        body.append(
            f'<tr><th scope="row">{escape(task)}</th>{_cell(whole[row], task=task)}{data}</tr>'
        )
    spans: dict[str, int] = defaultdict(int)
    for policy, _ in pairs:
        spans[policy] += 1
    top = "".join(
        f'<th scope="colgroup" colspan="{count}">{escape(policy)}</th>'
        for policy, count in spans.items()
    )
    second = "".join(f'<th scope="col">{escape(prompt)}</th>' for _, prompt in pairs)
    choices = "".join(
        f'<button type="button" data-metric="{m}" aria-pressed="{str(m == SHOWN[0]).lower()}">{m}</button>'
        for m in SHOWN
    )
    return (
        '<section id="heatmap" aria-labelledby="heatmap-title"><h2 id="heatmap-title">Tasks</h2>'
        f'<p class="soft"><span id="heatmap-what">Violation rate</span> of each task in percent; '
        "within a stage, the tasks with most violations first. A cell leads to its episodes.</p>"
        f'<div class="choices no-print" role="group" aria-label="Rate">{choices}</div>'
        '<div class="scroll tall" tabindex="0" role="region" aria-label="Rates by task"><table class="heat">'
        f'<thead><tr><th scope="col" rowspan="2">Task</th><th scope="col" rowspan="2">All</th>{top}</tr>'
        f"<tr>{second}</tr></thead><tbody>{''.join(body)}</tbody></table></div></section>"
    )


def _cell(cell: Rates | None, **where: str) -> str:
    """A share of all that were judged, an interval where some are undecided; it leads to its episodes."""
    bounds = None if cell is None else cell.bounds(SHOWN[0])
    if cell is None or bounds is None:
        return '<td class="none">–</td>'
    least = " ".join(str(cell.counts[metric] + cell.surely[metric]) for metric in SHOWN)
    most = " ".join(str(cell.counts[metric] + cell.maybe[metric]) for metric in SHOWN)
    low, high = (f"{100 * bound:.0f}" for bound in bounds)
    link = "&amp;".join(f"{name}={quote(value, safe='')}" for name, value in where.items())
    return (
        f'<td class="h{level(bounds[0])}" data-k="{least}" data-most="{most}" data-n="{cell.n + cell.inconclusive}">'
        f'<a href="#{link}">{low if low == high else f"{low}–{high}"}</a></td>'
    )


def level(share: float) -> int:
    """The shade, 0…10, of a share 0…1; only a share of 0 has shade 0."""
    return 0 if share <= 0 else max(1, min(10, round(10 * share)))
