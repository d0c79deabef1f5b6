"""The result tables of a campaign, for people, papers and programs."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from safestage_eval.metrics import METRICS, Aggregate, Group, Rate
from safestage_eval.metrics.aggregate import BY_POLICY, names_of, quadrants, rows
from safestage_eval.metrics.interval import RESAMPLES, bootstrap, wilson
from safestage_eval.metrics.rates import ALL, CONDITIONS, STAGES, headline
from safestage_eval.metrics.seeds import decimal, shown
from safestage_eval.verdicts.engagement import STAGES as ENGAGEMENT
from safestage_eval.version import __version__

from .summary import share, summary
from .table import Sheet, as_latex, as_markdown, as_text

FORMATS = ("table", "json", "csv", "markdown", "latex")
INTERVALS = ("none", "wilson", "bootstrap")

_ARROWS = {"SR": "SR ↑", "SSR": "SSR ↑"}


@dataclass(frozen=True)
class Drawing:
    """Which intervals stand in the tables, and how the bootstrap draws."""

    intervals: str = "none"
    seed: int = 0
    resamples: int = RESAMPLES


def render(found: Aggregate, form: str, drawing: Drawing | None = None) -> str:
    """The tables in one of ``FORMATS``. Raises KeyError for another."""
    drawing = drawing or Drawing()
    if form == "json":
        text = json.dumps(document(found, drawing), indent=1, ensure_ascii=False, allow_nan=False)
        return text + "\n"
    if form == "csv":
        return _csv(found, drawing)
    lay = {"table": as_text, "markdown": as_markdown, "latex": as_latex}[form]
    return lay(list(sheets(found, drawing)), notes(found))


def document(found: Aggregate, drawing: Drawing) -> dict[str, Any]:
    """Everything as one object; rates in percent."""
    return {
        "version": __version__,
        "unit": "percent",
        "by_policy": rows(found.by_policy),
        "by_stage": rows(found.by_stage),
        "by_family": rows(found.by_family),
        "unsafe_share": [_share(group) for group in _groups(found)],
        "quadrants": [
            {**_head(group), **quadrants(group.whole), "n": group.whole.n}
            for group in _groups(found)
        ],
        "headline": headline(found.whole),
        "conditions": [{**_head(group), **headline(group.whole)} for group in _groups(found)],
        "reached_hold": [_hold(group) for group in _final(found)],
        "details": [
            {"table": table, **_head(rate.group), "metric": rate.name, **_details(rate, drawing)}
            for table, rate in _rates(found)
        ],
        "problems": [asdict(problem) for problem in found.problems],
    }


def sheets(found: Aggregate, drawing: Drawing) -> Iterator[Sheet]:
    """The tables for people: by policy, by stage, what became of success, by family."""

    def cells(rates: Sequence[Rate]) -> list[str]:
        return [_cell(rate, drawing) for rate in rates]

    what = "mean ± sample standard deviation over environment seeds, %"
    width = len(BY_POLICY)
    yield Sheet(
        f"By policy: {what}",
        ("policy", "prompt", *(_ARROWS.get(name, f"{name} ↓") for name in BY_POLICY)),
        [
            [policy, prompt, *cells(found.by_policy[i * width : (i + 1) * width])]
            for i, (policy, prompt) in enumerate(found.pairs)
        ],
        2,
    )
    columns = tuple(_ARROWS.get(name, f"{name} ↓") for name in METRICS)
    width = len(METRICS)
    for title, head, rates in (
        ("By stage, over all policies", ("prompt", "stage"), found.by_stage),
        ("By family, over all policies", ("prompt", "stage", "family"), found.by_family),
    ):
        if rates:
            yield Sheet(
                f"{title}: {what}",
                (*head, *columns),
                [
                    [*(getattr(rates[i].group, name) for name in head), *cells(rates[i : i + width])]
                    for i in range(0, len(rates), width)
                ],
                len(head),
            )  # fmt: skip
    yield Sheet(
        "What became of them: rollouts, over all seeds",
        ("policy", "prompt", "stage", "safe success", "unsafe success", "safe failure",
         "unsafe failure", "N", "unsafe share of successes"),
        [
            [
                group.policy or "all", group.prompt or "all", group.stage or ALL,
                *map(str, quadrants(group.whole).values()), str(group.whole.n), _said_share(group),
            ]
            for group in _groups(found)
        ],
        3,
    )  # fmt: skip
    yield from _conditioned(_groups(found))
    final = [group for group in _final(found) if group.whole.n]
    if final:
        yield Sheet(
            "Final-state hazards: who reached the hold after success",
            ("policy", "prompt", "reached k/n", "of these unsafe"),
            [
                [
                    group.policy or "all", group.prompt or "all",
                    f"{group.whole.counts['SR']}/{group.whole.n}", _said_share(group),
                ]
                for group in final
            ],
            2,
        )  # fmt: skip


def _conditioned(groups: Sequence[Group]) -> Iterator[Sheet]:
    """Rates over the rollouts at risk, and how far the rollouts got, where either is known."""
    head = ("policy", "prompt", "stage")
    if any(group.whole.given["at risk"]["N"] for group in groups):
        yield Sheet(
            "Over the rollouts at risk: %, k/n over all seeds",
            (*head, *(_ARROWS.get(name, f"{name} ↓") for name in METRICS)),
            [
                [*_names(group), *(share(group.whole, name, "at risk") for name in METRICS)]
                for group in groups
            ],
            3,
        )
    if any(count for g in groups for stage, count in g.whole.engagement.items() if stage):
        yield Sheet(
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
        )


def _names(group: Group) -> tuple[str, str, str]:
    return group.policy or "all", group.prompt or "all", group.stage or ALL


def notes(found: Aggregate) -> list[str]:
    """How much was counted, why a number is not there, and what is uneven."""
    whole = found.whole
    lines = [f"{whole.n} rollouts are decided; SR, SSR, USR and VR of a cell are over the same N."]
    lines += [f"{line[:1].upper()}{line[1:]}." for line in summary(whole)]
    if whole.inconclusive:
        bounds = whole.bounds("VR")
        assert bounds is not None
        lines.append(
            f"{whole.inconclusive} inconclusive, not in N: whatever they are, VR over all lies "
            f"between {decimal(100 * bounds[0])} % and {decimal(100 * bounds[1])} %."
        )
    if whole.not_judged:
        lines.append(f"{whole.not_judged} not judged, not in N.")
    reasons: dict[str, list[str]] = {}
    for _, rate in _rates(found):
        if rate.reason:
            place = " ".join(v for v in names_of(rate.group).values() if v is not None)
            reasons.setdefault(rate.reason, []).append(f"{place} {rate.name}")
    for reason, places in reasons.items():
        some = ", ".join(places[:3]) + (f" and {len(places) - 3} more" if len(places) > 3 else "")
        lines.append(f"–: {reason} ({some}).")
    return lines


def _csv(found: Aggregate, drawing: Drawing) -> str:
    buffer = io.StringIO()
    columns = (
        "table", "policy", "prompt", "stage", "family", "metric", "mean", "std", "k", "n",
        "n_seeds", "wilson_low", "wilson_high", "bootstrap_low", "bootstrap_high", "least", "most",
        "inconclusive", "not_judged", "reason",
    )  # fmt: skip
    writer = csv.DictWriter(buffer, columns, lineterminator="\n", restval="")
    writer.writeheader()
    for table, rate in _rates(found):
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
        writer.writerow({"table": table, **row, **detail, **spread})
    return buffer.getvalue()


def _rates(found: Aggregate) -> Iterator[tuple[str, Rate]]:
    for table in ("by_policy", "by_stage", "by_family"):
        for rate in getattr(found, table):
            yield table, rate


def _groups(found: Aggregate) -> list[Group]:
    """Policy × prompt over all stages, then prompt × stage over all policies."""
    own = [found.group(policy, prompt, ALL) for policy, prompt in found.pairs]
    stages = [found.group(None, prompt, s) for prompt in found.prompts for s in (*STAGES, ALL)]
    return [group for group in (*own, *stages) if group.parts]


def _final(found: Aggregate) -> list[Group]:
    own = [found.group(policy, prompt, "FSH") for policy, prompt in found.pairs]
    return [*own, *(found.group(None, prompt, "FSH") for prompt in found.prompts)]


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
    if drawing.intervals == "none" or rate.mean is None:
        return text
    found = (
        wilson(rate.k, rate.n)
        if drawing.intervals == "wilson"
        else bootstrap(rate, drawing.seed, drawing.resamples)
    )
    pair = _percent(found)
    return f"{text} [–]" if pair is None else f"{text} [{', '.join(map(decimal, pair))}]"


def _percent(pair: Iterable[float] | None) -> list[float] | None:
    return None if pair is None else [100 * value for value in pair]
