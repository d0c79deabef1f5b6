"""The result tables of a campaign, for people, papers and programs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from safestage_eval._text.plural import count, first_few
from safestage_eval.metrics import METRICS, Aggregate, Group, Rate, Rates
from safestage_eval.metrics.aggregate import BY_POLICY, names_of, quadrants, rows
from safestage_eval.metrics.interval import RESAMPLES, bootstrap, wilson
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

_ARROWS = {"SR": "SR ↑", "SSR": "SSR ↑"}


@dataclass(frozen=True)
class Drawing:
    """Intervals shown in the tables, and the bootstrap's settings."""

    intervals: str = "none"
    seed: int = 0
    resamples: int = RESAMPLES


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

    def cells(rates: Sequence[Rate]) -> list[str]:
        return [_cell(rate, drawing) for rate in rates]

    def wholes(rates: Sequence[Rate], width: int) -> list[Rates]:
        return [rate.group.whole for rate in rates[::width]]

    statistic = "mean ± sample standard deviation over environment seeds, %"
    width = len(BY_POLICY)
    counts = judged(wholes(aggregate.by_policy, width))
    yield Table(
        f"By policy: {statistic}",
        ("policy", "prompt", *counts, *(_ARROWS.get(name, f"{name} ↓") for name in BY_POLICY)),
        [
            [
                policy,
                prompt,
                *(count(aggregate.by_policy[i * width].group.whole) for count in counts.values()),
                *cells(aggregate.by_policy[i * width : (i + 1) * width]),
            ]
            for i, (policy, prompt) in enumerate(aggregate.pairs)
        ],
        2,
        grouped=True,
    )
    columns = tuple(_ARROWS.get(name, f"{name} ↓") for name in METRICS)
    width = len(METRICS)
    for title, head, rates in (
        ("By stage, over all policies", ("prompt", "stage"), aggregate.by_stage),
        ("By family, over all policies", ("prompt", "stage", "family"), aggregate.by_family),
    ):
        if rates:
            counts = judged(wholes(rates, width))
            yield Table(
                f"{title}: {statistic}",
                (*head, *counts, *columns),
                [
                    [
                        *(getattr(rates[i].group, name) for name in head),
                        *(count(rates[i].group.whole) for count in counts.values()),
                        *cells(rates[i : i + width]),
                    ]
                    for i in range(0, len(rates), width)
                ],
                len(head),
                grouped=True,
            )  # fmt: skip
    yield Table(
        "What became of them: rollouts, over all seeds",
        ("policy", "prompt", "stage", "safe success", "unsafe success", "safe failure",
         "unsafe failure", "N", "unsafe share of successes"),
        [
            [
                *_names(group), *map(str, quadrants(group.whole).values()), str(group.whole.n), _said_share(group),
            ]
            for group in _groups(aggregate)
        ],
        3,
        grouped=True,
    )  # fmt: skip
    yield from _conditioned(_groups(aggregate))
    final = [group for group in _final(aggregate) if group.whole.n]
    if final:
        yield Table(
            "Final-state hazards: who reached the hold after success",
            ("policy", "prompt", "reached k/n", "of these unsafe"),
            [
                [
                    *_names(group)[:2],
                    f"{group.whole.counts['SR']}/{group.whole.n}", _said_share(group),
                ]
                for group in final
            ],
            2,
            grouped=True,
        )  # fmt: skip


def _conditioned(groups: Sequence[Group]) -> Iterator[Table]:
    """Rates over the rollouts that met the hazard, and how far the rollouts got, where either is known."""
    head = ("policy", "prompt", "stage")
    if any(group.whole.given["at risk"]["N"] for group in groups):
        yield Table(
            "Over the rollouts that met the hazard: %, k/n over all seeds",
            (*head, *(_ARROWS.get(name, f"{name} ↓") for name in METRICS)),
            [
                [*_names(group), *(share(group.whole, name, "at risk") for name in METRICS)]
                for group in groups
            ],
            3,
            grouped=True,
        )
    if any(count for g in groups for stage, count in g.whole.engagement.items() if stage):
        yield Table(
            "How far they got with the target: rollouts; VR given that they got so far: %, k/n",
            (*head, *ENGAGEMENT, "unknown", *(f"VR given {name}" for name in CONDITIONS[1:])),
            [
                [
                    *_names(group),
                    *map(str, group.whole.engagement.values()),
                    *(share(group.whole, "VR", name) for name in CONDITIONS[1:]),
                ]
                for group in groups
            ],
            3,
            grouped=True,
        )


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
        "bootstrap": _percent(bootstrap(rate, drawing.seed, drawing.resamples)),
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
        drawn = bootstrap(rate, drawing.seed, drawing.resamples)
        if drawn is None or drawn[0] < drawn[1]:  # all tasks alike say nothing of the spread
            ends = drawn
    pair = _percent(ends)
    return f"{text} [–]" if pair is None else f"{text} [{', '.join(map(decimal, pair))}]"


def _percent(pair: Iterable[float] | None) -> list[float] | None:
    return None if pair is None else [100 * value for value in pair]
