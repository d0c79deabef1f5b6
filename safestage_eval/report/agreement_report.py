"""Agreement of evaluator and people, for people, papers and programs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

from safestage_eval._text.plural import first_few
from safestage_eval._text.printable import printable
from safestage_eval.metrics.agreement import Agreement, Confusion, Disagreement
from safestage_eval.metrics.rates import ALL
from safestage_eval.version import __version__

from .document import Document
from .table import Table

COUNTS = ("n", "tp", "fp", "fn", "tn")
METRICS = ("precision", "recall", "f1", "accuracy", "kappa")
HEADS = {"f1": "F1", "n": "N", "tp": "TP", "fp": "FP", "fn": "FN", "tn": "TN"}
MOST = 8
"""Ids that are listed of those that have no partner."""
MAJORITY = "majority"


def render(agreement: Agreement, form: str) -> str:
    """A comparison in one of the formats table, json, csv."""
    by_stage = [_row(MAJORITY, *item) for item in agreement.stages.items()]
    by_reviewer = [
        _row(who, *item) for who, stages in agreement.reviewers.items() for item in stages.items()
    ]

    def facts() -> dict[str, Any]:
        return {
            "version": __version__,
            "by_stage": by_stage,
            "by_reviewer": by_reviewer,
            **_rest(agreement),
        }

    def records() -> list[dict[str, Any]]:
        names = ("reviewer", "stage", *COUNTS, *METRICS)
        return [{name: row[name] for name in names} for row in by_stage + by_reviewer]

    document = Document(
        [*_tables(agreement)], _notes(agreement), facts=facts, records=records
    )  # fmt: skip
    text = document.render(form)
    return text + "".join(_disagreements(agreement)) if form == "table" else text


def _row(reviewer: str, stage: str, counts: Confusion) -> dict[str, Any]:
    return {
        "reviewer": reviewer,
        "stage": stage,
        **{name: getattr(counts, name) for name in (*COUNTS, *METRICS)},
        "intervals": {name: list(ends) for name, ends in counts.intervals.items()},
        "undefined": counts.undefined,
    }


def _rest(agreement: Agreement) -> dict[str, Any]:
    """What JSON has besides the counts."""
    names = ("unsure", "tied", "undecided", "only_labels", "only_results", "replaced")
    return {
        "between_reviewers": {
            "pairs": [asdict(pair) for pair in agreement.pairs],
            "fleiss": {
                "kappa": agreement.fleiss,
                "n": agreement.fleiss_n,
                "why": agreement.why_no_fleiss,
            },
        },
        "disagreements": [
            {
                "episode_id": one.judged.episode_id,
                "stage": one.judged.stage,
                "violation": one.judged.violation,
                "label": _word(one.unsafe),
                "labels": [
                    {"reviewer": x.reviewer, "label": x.label, "note": x.note} for x in one.labels
                ],
                "witnesses": [asdict(witness) for witness in one.judged.witnesses],
            }
            for one in agreement.disagreements
        ],
        "left_out": {name: getattr(agreement, name) for name in names},
    }


def _tables(agreement: Agreement) -> Iterator[Table]:
    heads = tuple(HEADS.get(name, name) for name in (*COUNTS, *METRICS))
    rows = [(stage, *_cells(counts, intervals=True)) for stage, counts in agreement.stages.items()]
    title = "Evaluator against labels, violations positive; shares in %, [Wilson's 95 % interval]"
    yield Table(title, ("stage", *heads), rows, 1)
    if len(agreement.reviewers) > 1:
        each = [
            (who, stage, *_cells(counts, intervals=False))
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


def _cells(counts: Confusion, *, intervals: bool) -> list[str]:
    cells = [str(getattr(counts, name)) for name in COUNTS]
    for name in METRICS[:-1]:
        ends = counts.intervals.get(name) if intervals else None
        within = "" if ends is None else f" [{100 * ends[0]:.1f}, {100 * ends[1]:.1f}]"
        cells.append(_percent(getattr(counts, name)) + within)
    return [*cells, _kappa(counts.kappa)]


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100 * value:.2f}"


def _kappa(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _notes(agreement: Agreement) -> list[str]:
    """Sentences on what is left out, and on which measure has no value and why."""
    notes = []
    if len(agreement.reviewers) > 2:
        why = f": {agreement.why_no_fleiss}" if agreement.why_no_fleiss else f", N = {agreement.fleiss_n}"  # fmt: skip
        kappa = f"{_kappa(agreement.fleiss)}{why}"
        notes.append(f"Fleiss' kappa of all {len(agreement.reviewers)} reviewers: {kappa}")
    for what, counts in (
        ("nobody is sure", agreement.unsure),
        ("as many reviewers say safe as unsafe", agreement.tied),
    ):
        if counts:
            by_stage = ", ".join(f"{stage} {number}" for stage, number in counts.items())
            notes.append(f"{what}: {sum(counts.values())} ({by_stage}), in no count")
    for what, names in (
        ("labelled, but inconclusive or not judged", agreement.undecided),
        ("labels without a result", agreement.only_labels),
        ("results without a label", agreement.only_results),
    ):
        if names:
            notes.append(f"{what}: {len(names)}, in no count: {first_few(names, MOST)}")
    if agreement.replaced:
        notes.append(f"labels that their reviewer replaced by a later one: {agreement.replaced}")
    for stage, confusion in agreement.stages.items():
        reasons: dict[str, list[str]] = {}
        for name, why in confusion.undefined.items():
            reasons.setdefault(why, []).append(HEADS.get(name, name))
        notes += [f"–, {stage}: {', '.join(names)}: {why}" for why, names in reasons.items()]
    for pair in agreement.pairs:
        if pair.kappa is None:
            why = "both gave one and the same answer throughout" if pair.n else "nothing in common"
            notes.append(f"–, {pair.first} and {pair.second}: kappa: {why}")
    return notes


def _disagreements(agreement: Agreement) -> Iterator[str]:
    """Each with the witnesses of the evaluator, and what reviewers noted."""
    if agreement.disagreements:
        yield f"\nDisagreements: {len(agreement.disagreements)}\n"
    for one in agreement.disagreements:
        yield printable(f"  {one.judged.episode_id}, {one.judged.stage}: {_contrast(one)}") + "\n"
        for witness in one.judged.witnesses:
            when = "" if witness.time is None else f"at {witness.time:.2f} s"
            head = " ".join(filter(None, (witness.rule, when)))
            bodies = f" [{', '.join(witness.bodies)}]" if witness.bodies else ""
            said = witness.explanation or witness.verdict
            yield printable(f"    {head}{': ' * bool(head)}{said}{bodies}") + "\n"
        for label in one.labels:
            if label.note:
                whose = f" of {label.reviewer}" if label.reviewer else ""
                yield printable(f"    note{whose}: {' '.join(label.note.split())}") + "\n"


def _contrast(one: Disagreement) -> str:
    evaluator = "violation" if one.judged.violation else "no violation"
    named = [f"{x.reviewer}: {x.label}" for x in one.labels if x.reviewer]
    votes = f" ({', '.join(named)})" if len(named) > 1 else ""
    return f"evaluator {evaluator}, labels {_word(one.unsafe)}{votes}"


def _word(unsafe: bool) -> str:
    return "unsafe" if unsafe else "safe"
