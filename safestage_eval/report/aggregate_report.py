"""The result tables of a campaign, for people, papers and programs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

from safestage_eval._text.plural import count, first_few
from safestage_eval.metrics import METRICS, Aggregate, Group, Rate
from safestage_eval.metrics.aggregate import BY_POLICY, names_of, quadrants, rows
from safestage_eval.metrics.interval import bootstrap, wilson
from safestage_eval.metrics.rates import ALL, CONDITIONS, STAGES, headline
from safestage_eval.metrics.seeds import decimal, shown
from safestage_eval.verdicts.engagement import STAGES as ENGAGEMENT
from safestage_eval.version import __version__

from .document import Document
from .summary import coverage, judged, percent_between, share, summary
from .table import Table, table_of

TABLES = ("by_policy", "by_stage", "by_family")


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
    return Document(
        [*_tables(aggregate, drawing)],
        _notes(aggregate),
        coverage(aggregate.whole),
        lambda: _facts(aggregate, drawing),
        lambda: _records(aggregate, drawing),
        paper=2,
    ).render(form)


def _facts(aggregate: Aggregate, drawing: Drawing) -> dict[str, Any]:
    """Everything as one object; rates in percent."""
    groups = [(_head(group), group.whole) for group in _groups(aggregate)]
    return {
        "version": __version__,
        "unit": "percent",
        **{table: rows(getattr(aggregate, table)) for table in TABLES},
        "unsafe_share": [
            {
                **head,
                "share": 100 * k / n if n else None,
                "k": k,
                "n": n,
                "wilson": _percent(wilson(k, n)),
            }
            for head, whole in groups
            for k, n in [(whole.counts["USR"], whole.counts["SR"])]
        ],
        "quadrants": [{**head, **quadrants(whole), "n": whole.n} for head, whole in groups],
        "headline": headline(aggregate.whole),
        "conditions": [{**head, **headline(whole)} for head, whole in groups],
        "reached_hold": [
            {
                **_head(group),
                "k": group.whole.counts["SR"],
                "n": group.whole.n,
                "violations": group.whole.counts["USR"],
            }
            for group in _final(aggregate)
        ],
        "details": [
            {"table": table, **_head(rate.group), "metric": rate.name, **_details(rate, drawing)}
            for table in TABLES
            for rate in getattr(aggregate, table)
        ],
        "problems": [asdict(problem) for problem in aggregate.problems],
    }


def _records(aggregate: Aggregate, drawing: Drawing) -> list[dict[str, Any]]:
    """A row per rate, its intervals in two columns each."""
    columns = {
        "wilson": ("wilson_low", "wilson_high"),
        "bootstrap": ("bootstrap_low", "bootstrap_high"),
        "bounds": ("least", "most"),
    }
    named = dict.fromkeys(("table", "policy", "prompt", "stage", "family", "metric"))
    records = []
    for table in TABLES:
        for rate in getattr(aggregate, table):
            (row,) = rows([rate])
            details = _details(rate, drawing)
            ends = {
                name: end
                for key, names in columns.items()
                for name, end in zip(names, details.pop(key) or (None, None), strict=True)
            }
            records.append({**named, "table": table, **row, **ends, **details})
    return records


def _details(rate: Rate, drawing: Drawing) -> dict[str, Any]:
    return {
        "wilson": _percent(wilson(rate.k, rate.n)),
        "bootstrap": _percent(bootstrap(rate, drawing.seed)),
        "bounds": None if rate.bounds is None else list(rate.bounds),
        "inconclusive": rate.group.whole.inconclusive,
        "not_judged": rate.group.whole.not_judged,
        "reason": rate.reason,
    }


def _tables(aggregate: Aggregate, drawing: Drawing) -> Iterator[Table]:
    """The tables for people: by policy, by stage, by family, what became of them, how far they got."""
    yield _of_rates("By policy", ("policy", "prompt"), BY_POLICY, aggregate.by_policy, drawing)
    names = ("prompt", "stage", "family")
    yield _of_rates("By stage, over all policies", names[:2], METRICS, aggregate.by_stage, drawing)
    if aggregate.by_family:
        title = "By family, over all policies"
        yield _of_rates(title, names, METRICS, aggregate.by_family, drawing)
    groups = _groups(aggregate)
    became = ("safe success", "unsafe success", "safe failure", "unsafe failure")
    yield _of_groups(
        "What became of them: rollouts, over all seeds",
        groups,
        {
            **{head: partial(_became, head.replace(" ", "_")) for head in became},
            "N": lambda g: str(g.whole.n),
            "unsafe share of successes": _unsafe_share,
        },
    )
    if any(group.whole.given["at risk"]["N"] for group in groups):
        yield _of_groups(
            "Over the rollouts that met the hazard: %, k/n over all seeds",
            groups,
            {_arrow(metric): partial(_given, metric, "at risk") for metric in METRICS},
        )
    if any(group.whole.any_stage for group in groups):
        yield _of_groups(
            "How far they got with the target: rollouts; VR given that they got so far: %, k/n",
            groups,
            {
                **{stage or "unknown": partial(_reached, stage) for stage in (*ENGAGEMENT, None)},
                **{f"VR given {c}": partial(_given, "VR", c) for c in CONDITIONS[1:]},
            },
        )
    if final := [group for group in _final(aggregate) if group.whole.n]:
        yield _of_groups(
            "Final-state hazards: who reached the hold after success",
            final,
            {
                "reached k/n": lambda g: f"{g.whole.counts['SR']}/{g.whole.n}",
                "of these unsafe": _unsafe_share,
            },
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
    groups = [rates[i : i + len(names)] for i in range(0, len(rates), len(names))]
    counts = judged([row[0].group.whole for row in groups])
    rows = [
        [
            *(getattr(row[0].group, name) for name in head),
            *(said(row[0].group.whole) for said in counts.values()),
            *(_cell(rate, drawing) for rate in row),
        ]
        for row in groups
    ]
    heads = (*head, *counts, *map(_arrow, names))
    spread = "mean ± sample standard deviation over environment seeds, %"
    return Table(f"{title}: {spread}", heads, rows, len(head), grouped=True)


def _of_groups(
    title: str, groups: Sequence[Group], columns: Mapping[str, Callable[[Group], str]], names: int = 3
) -> Table:  # fmt: skip
    """A row for each group, named by so many of policy, prompt and stage."""
    named: dict[str, Callable[[Group], str]] = {
        "policy": lambda g: g.policy or "all",
        "prompt": lambda g: g.prompt or "all",
        "stage": lambda g: g.stage or ALL,
    }
    heads = {name: named[name] for name in [*named][:names]}
    return table_of(title, groups, {**heads, **columns}, names, grouped=True)


def _arrow(metric: str) -> str:
    """``SR ↑``, ``USR ↓``: which way is better."""
    return f"{metric} {'↑' if metric in ('SR', 'SSR') else '↓'}"


def _cell(rate: Rate, drawing: Drawing) -> str:
    """Mean and deviation, with the interval that is asked for; where there is no deviation, Wilson's."""
    ends = wilson(rate.k, rate.n)
    text = shown(rate.mean, rate.std)
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
    return f"{text} [{', '.join(map(decimal, _percent(ends) or ())) or '–'}]"


def _became(quadrant: str, group: Group) -> str:
    return str(quadrants(group.whole)[quadrant])


def _given(metric: str, condition: str, group: Group) -> str:
    return share(group.whole, metric, condition)


def _reached(stage: str | None, group: Group) -> str:
    return str(group.whole.engagement[stage])


def _unsafe_share(group: Group) -> str:
    k, n = group.whole.counts["USR"], group.whole.counts["SR"]
    return f"{decimal(100 * k / n)} {k}/{n}" if n else "– no success"


def _notes(aggregate: Aggregate) -> list[str]:
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
    for rate in (*aggregate.by_policy, *aggregate.by_stage, *aggregate.by_family):
        if rate.reason:
            place = " ".join(v for v in names_of(rate.group).values() if v is not None)
            reasons.setdefault(rate.reason, []).append(f"{place} {rate.name}")
    said = "; ".join(f"{why} ({first_few(places, 2)})" for why, places in reasons.items())
    if said:
        lines.append(f"No mean, or Wilson's 95 % interval instead of a deviation: {said}.")
    return lines


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


def _percent(pair: tuple[float, float] | None) -> list[float] | None:
    return None if pair is None else [100 * value for value in pair]
