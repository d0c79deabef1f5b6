"""Agreement of evaluator and people, for people, papers and programs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from typing import Any

from safestage_eval._text.plural import first_few
from safestage_eval._text.printable import printable
from safestage_eval.metrics.agreement import Agreement, Confusion, Disagreement
from safestage_eval.metrics.outcome import Witness
from safestage_eval.metrics.rates import ALL
from safestage_eval.version import __version__

from .render_csv import render_csv
from .render_json import render_json
from .render_text import render_text
from .table import Table

COUNTS = ("n", "tp", "fp", "fn", "tn")
METRICS = ("precision", "recall", "f1", "accuracy", "kappa")
HEADS = {"f1": "F1", "n": "N", "tp": "TP", "fp": "FP", "fn": "FN", "tn": "TN"}
MOST = 8
"""Ids that are listed of those that have no partner."""
MAJORITY = "majority"


def render(agreement: Agreement, form: str) -> str:
    """A comparison in one of the formats table, json, csv."""
    return {"table": _table, "json": _json, "csv": _csv}[form](agreement)


def _table(agreement: Agreement) -> str:
    lines = [render_text(list(_tables(agreement)), _notes(agreement))]
    if agreement.disagreements:
        lines.append(f"Disagreements: {len(agreement.disagreements)}")
        for one in agreement.disagreements:
            lines.append(
                printable(f"  {one.judged.episode_id}, {one.judged.stage}: {_contrast(one)}")
            )
            lines += [printable(f"    {text}") for text in _reasons(one)]
    return "\n".join(lines).rstrip("\n") + "\n"


def _json(agreement: Agreement) -> str:
    document = {
        "version": __version__,
        "by_stage": [_row(MAJORITY, *item) for item in agreement.stages.items()],
        "by_reviewer": [
            _row(who, *item)
            for who, stages in agreement.reviewers.items()
            for item in stages.items()
        ],
        "between_reviewers": {
            "pairs": [asdict(pair) for pair in agreement.pairs],
            "fleiss": {
                "kappa": agreement.fleiss,
                "n": agreement.fleiss_n,
                "why": agreement.why_no_fleiss,
            },
        },
        "disagreements": [_difference(one) for one in agreement.disagreements],
        "left_out": {
            "unsure": dict(agreement.unsure),
            "tied": dict(agreement.tied),
            "undecided": list(agreement.undecided),
            "only_labels": list(agreement.only_labels),
            "only_results": list(agreement.only_results),
            "replaced": agreement.replaced,
        },
    }
    return render_json(document)


def _csv(agreement: Agreement) -> str:
    everybody = ((MAJORITY, agreement.stages), *agreement.reviewers.items())
    rows = [_row(who, *item) for who, stages in everybody for item in stages.items()]
    return render_csv(("reviewer", "stage", *COUNTS, *METRICS), rows)


def _row(reviewer: str, stage: str, counts: Confusion) -> dict[str, Any]:
    return {
        "reviewer": reviewer,
        "stage": stage,
        **{name: getattr(counts, name) for name in (*COUNTS, *METRICS)},
        "intervals": {name: list(ends) for name, ends in counts.intervals.items()},
        "undefined": counts.undefined,
    }


def _difference(one: Disagreement) -> dict[str, Any]:
    return {
        "episode_id": one.judged.episode_id,
        "stage": one.judged.stage,
        "violation": one.judged.violation,
        "label": _word(one.unsafe),
        "labels": [{"reviewer": x.reviewer, "label": x.label, "note": x.note} for x in one.labels],
        "witnesses": [asdict(witness) for witness in one.judged.witnesses],
    }


def _tables(agreement: Agreement) -> Iterator[Table]:
    heads = tuple(HEADS.get(name, name) for name in (*COUNTS, *METRICS))
    rows = [(stage, *_cells(counts, intervals=True)) for stage, counts in agreement.stages.items()]
    title = "Evaluator against labels, violations positive; shares in %, [Wilson's 95 % interval]"
    yield Table(title, ("stage", *heads), rows, 1)
    if len(agreement.reviewers) > 1:
        each = [
            (who, stage, *_cells(counts))
            for who, stages in agreement.reviewers.items()
            for stage, counts in stages.items()
            if counts.n or stage == ALL
        ]
        head = ("reviewer", "stage", *heads)
        yield Table("Evaluator against each reviewer", head, each, 2, grouped=True)
    if agreement.pairs:
        pairs = [
            (x.first, x.second, str(x.n), _percent(x.alike / x.n if x.n else None), _kappa(x.kappa))
            for x in agreement.pairs
        ]
        head = ("reviewer", "and", "N", "alike", "Cohen's kappa")
        yield Table("Reviewers with each other", head, pairs, 2, grouped=True)


def _cells(counts: Confusion, *, intervals: bool = False) -> tuple[str, ...]:
    shares = []
    for name in METRICS[:-1]:
        ends = counts.intervals.get(name) if intervals else None
        within = "" if ends is None else f" [{100 * ends[0]:.1f}, {100 * ends[1]:.1f}]"
        shares.append(_percent(getattr(counts, name)) + within)
    return (*(str(getattr(counts, name)) for name in COUNTS), *shares, _kappa(counts.kappa))


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.2f}"


def _kappa(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _notes(agreement: Agreement) -> list[str]:
    """Sentences on what is left out, and on which measure has no value and why."""
    notes = []
    if len(agreement.reviewers) > 2:
        value = _kappa(agreement.fleiss)
        reason = (
            f": {agreement.why_no_fleiss}"
            if agreement.why_no_fleiss
            else f", N = {agreement.fleiss_n}"
        )
        notes.append(f"Fleiss' kappa of all {len(agreement.reviewers)} reviewers: {value}{reason}")
    notes += [
        f"{what}: {sum(counts.values())} ({_by_stage(counts)}), in no count"
        for what, counts in (
            ("nobody is sure", agreement.unsure),
            ("as many reviewers say safe as unsafe", agreement.tied),
        )
        if counts
    ]
    notes += [
        f"{what}: {len(names)}, in no count: {first_few(names, MOST)}"
        for what, names in (
            ("labelled, but inconclusive or not judged", agreement.undecided),
            ("labels without a result", agreement.only_labels),
            ("results without a label", agreement.only_results),
        )
        if names
    ]
    if agreement.replaced:
        notes.append(f"labels that their reviewer replaced by a later one: {agreement.replaced}")
    for stage, counts in agreement.stages.items():
        reasons: dict[str, list[str]] = {}
        for name, why in counts.undefined.items():
            reasons.setdefault(why, []).append(HEADS.get(name, name))
        notes += [f"–, {stage}: {', '.join(names)}: {why}" for why, names in reasons.items()]
    for pair in agreement.pairs:
        if pair.kappa is None:
            why = "both gave one and the same answer throughout" if pair.n else "nothing in common"
            notes.append(f"–, {pair.first} and {pair.second}: kappa: {why}")
    return notes


def _by_stage(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{stage} {number}" for stage, number in counts.items())


def _contrast(one: Disagreement) -> str:
    evaluator = "violation" if one.judged.violation else "no violation"
    named = [f"{x.reviewer}: {x.label}" for x in one.labels if x.reviewer]
    votes = f" ({', '.join(named)})" if len(named) > 1 else ""
    return f"evaluator {evaluator}, labels {_word(one.unsafe)}{votes}"


def _reasons(one: Disagreement) -> Iterable[str]:
    """The witnesses, and what reviewers noted."""
    for witness in one.judged.witnesses:
        yield _witness_line(witness)
    for label in one.labels:
        if label.note:
            whose = f" of {label.reviewer}" if label.reviewer else ""
            yield f"note{whose}: {' '.join(label.note.split())}"


def _witness_line(witness: Witness) -> str:
    when = "" if witness.time is None else f"at {witness.time:.2f} s"
    head = " ".join(part for part in (witness.rule, when) if part)
    bodies = f" [{', '.join(witness.bodies)}]" if witness.bodies else ""
    return (f"{head}: " if head else "") + (witness.explanation or witness.verdict) + bodies


def _word(unsafe: bool) -> str:
    return "unsafe" if unsafe else "safe"
