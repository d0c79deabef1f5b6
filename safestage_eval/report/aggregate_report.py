"""The result tables of a campaign, for people, papers and programs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from safestage_eval._text.plural import count, first_few
from safestage_eval.metrics import METRICS, Aggregate, Group, Rate
from safestage_eval.metrics.aggregate import BY_POLICY, names_of, quadrants, rows
from safestage_eval.metrics.interval import bootstrap, wilson
from safestage_eval.metrics.rates import ALL, CONDITIONS, STAGES, headline
from safestage_eval.metrics.seeds import decimal, shown
from safestage_eval.verdicts.engagement import STAGES as ENGAGEMENT
from safestage_eval.version import __version__

from .render_csv import render_csv
from .render_html import render_html
from .render_json import render_json
from .render_latex import render_latex
from .render_markdown import render_markdown
from .render_text import render_text
from .summary import coverage, judged, percent_between, share, summary
from .table import Table


@dataclass(frozen=True)
class Drawing:
    """Intervals shown in the tables, and the bootstrap's seed."""

    intervals: str = "none"
    seed: int = 0


def render(aggregate: Aggregate, form: str, drawing: Drawing | None = None) -> str:
    """The tables in one of ``report.TABLE_FORMATS``, html or latex. Raises KeyError for another.

    LaTeX is for the paper: the tables by policy and by stage.
    """
    drawing = drawing or Drawing()
    if form == "json":
        return render_json(document(aggregate, drawing))
    if form == "csv":
        return _csv(aggregate, drawing)
    drawn, said = list(tables(aggregate, drawing)), notes(aggregate)
    if form == "html":
        return render_html(drawn, said)
    lead = coverage(aggregate.whole)
    if form == "latex":
        return render_latex(drawn[:2], said, lead)
    return {"table": render_text, "markdown": render_markdown}[form](drawn, said, lead)


def document(aggregate: Aggregate, drawing: Drawing) -> dict[str, Any]:
    """Everything as one object; rates in percent."""
    return {
        "version": __version__,
        "unit": "percent",
        "by_policy": rows(aggregate.by_policy),
        "by_stage": rows(aggregate.by_stage),
        "by_family": rows(aggregate.by_family),
        "unsafe_share": [_share(group) for group in _groups(aggregate)],
        "quadrants": [
            {**_head(group), **quadrants(group.whole), "n": group.whole.n}
            for group in _groups(aggregate)
        ],
        "headline": headline(aggregate.whole),
        "conditions": [{**_head(group), **headline(group.whole)} for group in _groups(aggregate)],
        "reached_hold": [_hold(group) for group in _final(aggregate)],
        "details": [
            {"table": table, **_head(rate.group), "metric": rate.name, **_details(rate, drawing)}
            for table, rate in _rates(aggregate)
        ],
        "problems": [asdict(problem) for problem in aggregate.problems],
    }


def tables(aggregate: Aggregate, drawing: Drawing) -> Iterator[Table]:
    """The tables for people: by policy, by stage, what became of success, by family."""
    for title, head, names, rates in (
        ("By policy", ("policy", "prompt"), BY_POLICY, aggregate.by_policy),
        ("By stage, over all policies", ("prompt", "stage"), METRICS, aggregate.by_stage),
        ("By family, over all policies", ("prompt", "stage", "family"), METRICS, aggregate.by_family),
    ):  # fmt: skip
        if rates:
            yield _of_rates(title, head, names, rates, drawing)
    groups = _groups(aggregate)
    yield _of_groups(
        "What became of them: rollouts, over all seeds",
        ("safe success", "unsafe success", "safe failure", "unsafe failure", "N",
         "unsafe share of successes"),
        groups,
        lambda g: [*map(str, quadrants(g.whole).values()), str(g.whole.n), _said_share(g)],
    )  # fmt: skip
    if any(group.whole.given["at risk"]["N"] for group in groups):
        yield _of_groups(
            "Over the rollouts that met the hazard: %, k/n over all seeds",
            [*map(_head_of, METRICS)],
            groups,
            lambda g: [share(g.whole, name, "at risk") for name in METRICS],
        )
    if any(count for g in groups for stage, count in g.whole.engagement.items() if stage):
        yield _of_groups(
            "How far they got with the target: rollouts; VR given that they got so far: %, k/n",
            (*ENGAGEMENT, "unknown", *(f"VR given {name}" for name in CONDITIONS[1:])),
            groups,
            lambda g: [
                *map(str, g.whole.engagement.values()),
                *(share(g.whole, "VR", name) for name in CONDITIONS[1:]),
            ],
        )
    if final := [group for group in _final(aggregate) if group.whole.n]:
        yield _of_groups(
            "Final-state hazards: who reached the hold after success",
            ("reached k/n", "of these unsafe"),
            final,
            lambda g: [f"{g.whole.counts['SR']}/{g.whole.n}", _said_share(g)],
            2,
        )


def _of_rates(
    title: str,
    head: tuple[str, ...],
    names: Sequence[str],
    rates: Sequence[Rate],
    drawing: Drawing,
) -> Table:
    """A row for each group: as many rates of it as there are ``names``."""
    rows = [rates[i : i + len(names)] for i in range(0, len(rates), len(names))]
    counts = judged([row[0].group.whole for row in rows])
    return Table(
        f"{title}: mean ± sample standard deviation over environment seeds, %",
        (*head, *counts, *map(_head_of, names)),
        [
            [
                *(getattr(row[0].group, name) for name in head),
                *(count(row[0].group.whole) for count in counts.values()),
                *(_cell(rate, drawing) for rate in row),
            ]
            for row in rows
        ],
        len(head),
        grouped=True,
    )


def _of_groups(
    title: str,
    columns: Sequence[str],
    groups: Sequence[Group],
    cells: Callable[[Group], list[str]],
    names: int = 3,
) -> Table:
    """A row for each group, with what ``cells`` says of it; ``names``: by how many columns it is named."""
    head = ("policy", "prompt", "stage")[:names]
    rows = [[*_names(group)[:names], *cells(group)] for group in groups]
    return Table(title, (*head, *columns), rows, names, grouped=True)


def _head_of(metric: str) -> str:
    """``SR ↑``, ``USR ↓``: which way is better."""
    return f"{metric} {'↑' if metric in ('SR', 'SSR') else '↓'}"


def _names(group: Group) -> tuple[str, str, str]:
    return group.policy or "all", group.prompt or "all", group.stage or ALL


def notes(aggregate: Aggregate) -> list[str]:
    """Sentences on what was counted, and why a number is missing."""
    whole = aggregate.whole
    lines = ["SR, SSR, USR and VR of a cell are over the same N, the rollouts that were judged."]
    lines += [f"{line[:1].upper()}{line[1:]}." for line in summary(whole)]
    if whole.inconclusive:
        between = percent_between(*(whole.bounds("VR") or (None, None)))
        lines.append(f"{whole.inconclusive} undecided, left out here: VR over all is {between}.")
    if whole.not_judged:
        lines.append(f"{count(whole.not_judged, 'episode')} not judged and left out of all rates.")
    reasons: dict[str, list[str]] = {}
    for _, rate in _rates(aggregate):
        if rate.reason:
            place = " ".join(v for v in names_of(rate.group).values() if v is not None)
            reasons.setdefault(rate.reason, []).append(f"{place} {rate.name}")
    said = [f"{reason} ({first_few(places, 2)})" for reason, places in reasons.items()]
    if said:
        lines.append(
            f"No mean, or Wilson's 95 % interval instead of a deviation: {'; '.join(said)}."
        )
    return lines


def _csv(aggregate: Aggregate, drawing: Drawing) -> str:
    columns = (
        "table", "policy", "prompt", "stage", "family", "metric", "mean", "std", "k", "n",
        "n_seeds", "wilson_low", "wilson_high", "bootstrap_low", "bootstrap_high", "least", "most",
        "inconclusive", "not_judged", "reason",
    )  # fmt: skip
    lines = []
    for table, rate in _rates(aggregate):
        detail = _details(rate, drawing)
        pairs = {
            "wilson": ("wilson_low", "wilson_high"),
            "bootstrap": ("bootstrap_low", "bootstrap_high"),
            "bounds": ("least", "most"),
        }
        spread = {
            name: value
            for key, names in pairs.items()
            for name, value in zip(names, detail.pop(key) or (None, None), strict=True)
        }
        (row,) = rows([rate])
        lines.append({"table": table, **row, **detail, **spread})
    return render_csv(columns, lines)


def _rates(aggregate: Aggregate) -> Iterator[tuple[str, Rate]]:
    for table in ("by_policy", "by_stage", "by_family"):
        for rate in getattr(aggregate, table):
            yield table, rate


def _groups(aggregate: Aggregate) -> list[Group]:
    """Policy × prompt over all stages, then prompt × stage over all policies."""
    own = [aggregate.group(policy, prompt, ALL) for policy, prompt in aggregate.pairs]
    stages = [
        aggregate.group(None, prompt, s) for prompt in aggregate.prompts for s in (*STAGES, ALL)
    ]
    return [group for group in (*own, *stages) if group.parts]


def _final(aggregate: Aggregate) -> list[Group]:
    own = [aggregate.group(policy, prompt, "FSH") for policy, prompt in aggregate.pairs]
    return [*own, *(aggregate.group(None, prompt, "FSH") for prompt in aggregate.prompts)]


def _head(group: Group) -> dict[str, str | None]:
    return {name: getattr(group, name) for name in ("policy", "prompt", "stage", "family")}


def _share(group: Group) -> dict[str, Any]:
    k, n = group.whole.counts["USR"], group.whole.counts["SR"]
    return {
        **_head(group),
        "share": 100 * k / n if n else None,
        "k": k,
        "n": n,
        "wilson": _percent(wilson(k, n)),
    }


def _said_share(group: Group) -> str:
    k, n = group.whole.counts["USR"], group.whole.counts["SR"]
    return f"{decimal(100 * k / n)} {k}/{n}" if n else "– no success"


def _hold(group: Group) -> dict[str, Any]:
    counts = group.whole.counts
    return {
        **_head(group),
        "k": counts["SR"],
        "n": group.whole.n,
        "violations": counts["USR"],
    }


def _details(rate: Rate, drawing: Drawing) -> dict[str, Any]:
    whole = rate.group.whole
    return {
        "wilson": _percent(wilson(rate.k, rate.n)),
        "bootstrap": _percent(bootstrap(rate, drawing.seed)),
        "bounds": None if rate.bounds is None else list(rate.bounds),
        "inconclusive": whole.inconclusive,
        "not_judged": whole.not_judged,
        "reason": rate.reason,
    }


def _cell(rate: Rate, drawing: Drawing) -> str:
    text = shown(rate.mean, rate.std)
    ends = wilson(rate.k, rate.n)
    if rate.mean is not None and rate.std is None:
        text = decimal(rate.mean)
        if drawing.intervals == "none":
            return f"{text} [{', '.join(decimal(100 * end, 0) for end in ends or ())}]"
    if drawing.intervals == "none" or rate.mean is None:
        return text
    if drawing.intervals == "bootstrap":
        drawn = bootstrap(rate, drawing.seed)
        if drawn is None or drawn[0] < drawn[1]:  # all tasks alike say nothing of the spread
            ends = drawn
    pair = _percent(ends)
    return f"{text} [–]" if pair is None else f"{text} [{', '.join(map(decimal, pair))}]"


def _percent(pair: Iterable[float] | None) -> list[float] | None:
    return None if pair is None else [100 * value for value in pair]
