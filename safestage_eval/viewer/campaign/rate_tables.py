"""The two result tables: by policy and prompt, and by prompt and stage."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from safestage_eval.metrics.aggregate import Aggregate
from safestage_eval.metrics.rates import CONDITIONS, METRICS
from safestage_eval.metrics.seeds import Rate, shown
from safestage_eval.report.summary import share

DIRECTION = {"SR": "↑", "SSR": "↑"}
"""Higher is better; of all others lower is."""


def tables(aggregate: Aggregate) -> str:
    """Write both tables, and notes on unevenness."""
    by_policy = [(r.group.policy or "–", r.group.prompt or "–", r) for r in aggregate.by_policy]
    by_stage = [(r.group.prompt or "–", r.group.stage or "All", r) for r in aggregate.by_stage]
    notes = [escape(problem.message) for problem in aggregate.problems]
    reasons: dict[str, dict[str, None]] = {}
    for rate in (*aggregate.by_policy, *aggregate.by_stage):
        if rate.reason:
            reasons.setdefault(rate.reason, {})[rate.name] = None
    notes += [escape(f"{', '.join(names)}: {reason}.") for reason, names in reasons.items()]
    items = "".join(f"<li>{note}</li>" for note in dict.fromkeys(notes))
    return (
        '<section id="tables" aria-labelledby="tables-title"><h2 id="tables-title">Result tables</h2>'
        '<p class="soft">Mean ± sample standard deviation over environment seeds, in percent. '
        "All rates of a row group are over the same rollouts, so SR = SSR + USR.</p>"
        + _table("By policy and prompt", ("Policy", "Prompt"), by_policy)
        + _table("By prompt and stage, over all policies", ("Prompt", "Stage"), by_stage)
        + _conditions(aggregate)
        + (f'<div class="small"><h3>Notes</h3><ul>{items}</ul></div>' if items else "")
        + "</section>"
    )


def _conditions(aggregate: Aggregate) -> str:
    """Rates over the rollouts at risk, and VR by how far they got; empty without either."""
    groups = [(a, b, aggregate.group(a, b).whole) for a, b in aggregate.pairs]
    columns = [("at risk", metric) for metric in METRICS]
    columns += [(name, "VR") for name in CONDITIONS[1:]]
    given_ones = {
        given for given, _ in columns if any(cell.given[given]["N"] for *_, cell in groups)
    }
    columns = [(given, metric) for given, metric in columns if given in given_ones]
    if not given_ones - {"success"}:
        return ""
    head = "".join(
        f'<th scope="col" class="amount">{metric} <small>{given}</small></th>'
        for given, metric in columns
    )
    rows = "".join(
        f'<tr class="group"><th scope="row">{escape(policy)}</th><th scope="row">{escape(prompt)}</th>'
        + "".join(_share_cell(share(cell, m, given)) for given, m in columns)
        + "</tr>"
        for policy, prompt, cell in groups
    )
    title = (
        "Over the rollouts at risk, and VR given success, release and manipulation: percent, k/n"
    )
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{title}"><table class="results">'
        f"<caption>{title}</caption><thead><tr>"
        f'<th scope="col">Policy</th><th scope="col">Prompt</th>{head}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
    )


def _table(title: str, names: tuple[str, str], rates: Sequence[tuple[str, str, Rate]]) -> str:
    metrics = list(dict.fromkeys(rate.name for _, _, rate in rates))
    head = "".join(
        f'<th scope="col" class="amount">{m} <span aria-hidden="true">{DIRECTION.get(m, "↓")}</span>'
        f'<span class="visually-hidden">{"higher" if m in DIRECTION else "lower"} is better</span></th>'
        for m in metrics
    )
    rows: dict[tuple[str, str], dict[str, Rate]] = {}
    for first, second, rate in rates:
        rows.setdefault((first, second), {})[rate.name] = rate
    body, above = [], None
    for (first, second), cells in rows.items():
        group = "" if first == above else ' class="group"'
        name = (
            f'<th scope="row">{escape(first)}</th>'
            if group
            else f'<th scope="row"><span class="visually-hidden">{escape(first)}</span></th>'
        )
        above = first
        data = "".join(_cell(cells.get(m)) for m in metrics)
        body.append(f'<tr{group}>{name}<th scope="row">{escape(second)}</th>{data}</tr>')
    columns = "".join(f'<th scope="col">{name}</th>' for name in names)
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{title}"><table class="results">'
        f"<caption>{title}</caption><thead><tr>{columns}{head}</tr></thead>"
        f"<tbody>{''.join(body)}</tbody></table></div>"
    )


def _share_cell(text: str) -> str:
    """``"50.0 6/12"``: the counts stand below."""
    value, _, counts = text.partition(" ")
    below = f'<small class="soft">{counts}</small>' if counts else ""
    return f'<td class="amount">{value}{below}</td>'


def _cell(rate: Rate | None) -> str:
    if rate is None:
        return '<td class="amount">–</td>'
    mean = shown(rate.mean, rate.std)
    why = f' title="{escape(rate.reason)}"' if rate.reason else ""
    return f'<td class="amount"{why}>{mean}<small class="soft">{rate.k:,}/{rate.n:,}</small></td>'
