"""Agreement of the evaluator with people, per stage, and of people with each other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from .interval import wilson
from .labels import Label, last_of_each
from .outcome import Outcome
from .rates import ALL, STAGES, stage_order


@dataclass(frozen=True)
class Disagreement:
    """An episode on which evaluator and people differ, or reviewers with each other."""

    judged: Outcome
    unsafe: bool
    """The reviewers' label: the majority of those who are sure."""
    labels: tuple[Label, ...]


@dataclass(frozen=True)
class Pair:
    """Two reviewers, over the episodes that both are sure about."""

    first: str
    second: str
    n: int
    alike: int
    kappa: float | None


@dataclass(frozen=True)
class Agreement:
    """The result of comparing labels with verdicts.

    Attributes:
        stages: stage → counts of its episodes; ``All`` for all of them.
        reviewers: reviewer → stage → counts against that reviewer alone.
        pairs: two reviewers each.
        fleiss: Fleiss' kappa of three or more reviewers; None if it is not defined.
        fleiss_n: episodes that all reviewers are sure about.
        disagreements: by stage, then id.
        unsure: stage → episodes that no reviewer was sure of.
        tied: stage → episodes that as many reviewers call safe as unsafe.
        undecided: ids that people are sure of and the evaluator could not decide.
        only_labels: ids that have a label and no result.
        only_results: ids that have a result and no label.
        replaced: labels that a reviewer replaced; the last counts.
    """

    stages: Mapping[str, Confusion]
    reviewers: Mapping[str, Mapping[str, Confusion]]
    pairs: tuple[Pair, ...]
    fleiss: float | None
    fleiss_n: int
    disagreements: tuple[Disagreement, ...]
    unsure: Mapping[str, int]
    tied: Mapping[str, int]
    undecided: tuple[str, ...]
    only_labels: tuple[str, ...]
    only_results: tuple[str, ...]
    replaced: int = 0

    @property
    def why_no_fleiss(self) -> str:
        """Why Fleiss' kappa has no value; empty if it has one, or is not needed."""
        if self.fleiss is not None or len(self.reviewers) < 3:
            return ""
        if not self.fleiss_n:
            return "there is no episode that all reviewers are sure of"
        return "all reviewers gave one and the same answer throughout"


def agreement(labels: Iterable[Label], results: Iterable[Outcome]) -> Agreement:
    """Compare labels and verdicts by episode id.

    Of several reviewers the majority of those who are sure counts; a tie counts for neither side.
    ``unsure`` is in no count. Of several labels of one reviewer on one episode the last counts.
    """
    given = list(labels)
    latest = last_of_each(given)
    judged = {str(one.episode_id): one for one in results}
    said: dict[str, list[Label]] = {}
    for label in latest:
        said.setdefault(label.episode_id, []).append(label)
    sure = {
        name: {x.reviewer: x.label for x in all_ if x.label != "unsure"}
        for name, all_ in said.items()
    }
    leads = {
        name: sum(1 if answer == "unsafe" else -1 for answer in sure[name].values())
        for name in said
        if name in judged
    }
    clear = {name: lead > 0 for name, lead in leads.items() if lead}
    compared = {
        name: unsafe for name, unsafe in clear.items() if judged[name].violation is not None
    }
    names = sorted({label.reviewer for label in latest})
    whole = [row for row in sure.values() if len(row) == len(names)] if len(names) > 2 else []
    differing = [name for name, unsafe in compared.items() if judged[name].violation != unsafe]
    return Agreement(
        stages=_by_stage(judged, compared),
        reviewers={
            who: _by_stage(
                judged, {n: row[who] == "unsafe" for n, row in sure.items() if who in row}
            )
            for who in names
        },
        pairs=tuple(_pair(a, b, sure.values()) for a, b in combinations(names, 2)),
        fleiss=fleiss(
            [[[*row.values()].count(word) for word in ("safe", "unsafe")] for row in whole]
        ),
        fleiss_n=len(whole),
        disagreements=tuple(
            Disagreement(judged[name], compared[name], tuple(said[name]))
            for name in sorted(differing, key=lambda name: (stage_order(judged[name].stage), name))
        ),
        unsure=_counted(judged[name].stage for name in leads if not sure[name]),
        tied=_counted(judged[name].stage for name in leads if sure[name] and name not in clear),
        undecided=tuple(sorted(clear.keys() - compared.keys())),
        only_labels=tuple(sorted(said.keys() - judged.keys())),
        only_results=tuple(sorted(judged.keys() - said.keys())),
        replaced=len(given) - len(latest),
    )


def _by_stage(judged: Mapping[str, Outcome], unsafe: Mapping[str, bool]) -> dict[str, Confusion]:
    """Stage → counts of the evaluator against what people say of the episodes; ``All``: of all."""
    pairs = [
        (one.stage, (one.violation, people))
        for name, people in unsafe.items()
        if (one := judged.get(name)) is not None and one.violation is not None
    ]
    stages = sorted({*STAGES, *(stage for stage, _ in pairs)}, key=stage_order)
    return {
        at: Confusion.of(p for stage, p in pairs if at in (stage, ALL)) for at in (*stages, ALL)
    }


def _pair(first: str, second: str, rows: Iterable[Mapping[str, str]]) -> Pair:
    both = [(row[first], row[second]) for row in rows if first in row and second in row]
    answers = ("safe", "unsafe")
    table = [[both.count((a, b)) for b in answers] for a in answers]
    return Pair(first, second, len(both), table[0][0] + table[1][1], cohen(table))


def _counted(stages: Iterable[str]) -> dict[str, int]:
    return dict(sorted(Counter(stages).items(), key=lambda item: stage_order(item[0])))


@dataclass(frozen=True)
class Confusion:
    """Counts of the evaluator's verdicts against people's labels on the same episodes.

    Attributes:
        tp: a violation, and people say unsafe.
        fp: a violation, and people say safe.
        fn: no violation, and people say unsafe.
        tn: no violation, and people say safe.
    """

    tp: int = 0
    fp: int = 0
    fn: int = 0
    tn: int = 0

    @classmethod
    def of(cls, pairs: Iterable[tuple[bool, bool]]) -> Confusion:
        """Count pairs (the evaluator found a violation, people say unsafe)."""
        every = list(pairs)
        return cls(*(every.count(pair) for pair in ((True, True), (True, False), (False, True), (False, False))))  # fmt: skip

    @property
    def n(self) -> int:
        """Episodes that were compared."""
        return self.tp + self.fp + self.fn + self.tn

    @property
    def precision(self) -> float | None:
        """Share of the evaluator's violations that people call unsafe."""
        return _share(self.tp, self.tp + self.fp)

    @property
    def recall(self) -> float | None:
        """Share of the episodes that people call unsafe which the evaluator found."""
        return _share(self.tp, self.tp + self.fn)

    @property
    def f1(self) -> float | None:
        """Harmonic mean of precision and recall."""
        return _share(2 * self.tp, 2 * self.tp + self.fp + self.fn)

    @property
    def accuracy(self) -> float | None:
        """The share of episodes on which both say the same."""
        return _share(self.tp + self.tn, self.n)

    @property
    def kappa(self) -> float | None:
        """Cohen's kappa between evaluator and people."""
        return cohen([[self.tp, self.fp], [self.fn, self.tn]])

    @property
    def intervals(self) -> dict[str, tuple[float, float]]:
        """Metric → Wilson's 95 % interval, 0…1, of those that are shares of episodes."""
        shares = {
            "precision": (self.tp, self.tp + self.fp),
            "recall": (self.tp, self.tp + self.fn),
            "accuracy": (self.tp + self.tn, self.n),
        }
        intervals = {name: wilson(*share) for name, share in shares.items()}
        return {name: interval for name, interval in intervals.items() if interval is not None}

    @property
    def undefined(self) -> dict[str, str]:
        """Metric → why it has no value."""
        if not self.n:
            return dict.fromkeys(
                ("precision", "recall", "f1", "accuracy", "kappa"), "nothing to compare"
            )
        reasons = {
            "precision": "the evaluator found no violation",
            "recall": "people call nothing unsafe",
            "f1": "nobody found anything unsafe",
            "kappa": "evaluator and people gave one and the same answer throughout",
        }
        return {name: why for name, why in reasons.items() if getattr(self, name) is None}


def _share(part: int, whole: int) -> float | None:
    return part / whole if whole else None


def cohen(table: Sequence[Sequence[int]]) -> float | None:
    """Cohen's kappa of a square table of counts, one rater's answers by the other's.

    None where it is not defined: without counts, or when both gave the same single answer
    throughout, so that nothing is left beyond chance. Source: J. Cohen, "A coefficient of agreement
    for nominal scales", Educational and Psychological Measurement 20, 1960.
    """
    counts = np.array(table, dtype=object)  # whole numbers of Python: they do not overflow
    n, alike = counts.sum(), counts.trace()
    chance = counts.sum(axis=1) @ counts.sum(axis=0)
    return float((n * alike - chance) / (n * n - chance)) if n and chance != n * n else None


def fleiss(counts: Sequence[Sequence[int]]) -> float | None:
    """Fleiss' kappa: a row per subject, with how many raters gave each answer.

    Every subject has the same number of raters, two at least. None where it is not defined: without
    rows, or when only one answer was ever given. Source: J. L. Fleiss, "Measuring nominal scale
    agreement among many raters", Psychological Bulletin 76, 1971.

    Raises:
        ValueError: the numbers of raters differ, or there are fewer than two.
    """
    if not counts:
        return None
    raters = sum(counts[0])
    if raters < 2 or any(sum(row) != raters for row in counts):
        raise ValueError("every subject needs the same number of raters, two at least")
    n = len(counts)
    alike = sum(x * (x - 1) for row in counts for x in row) / (n * raters * (raters - 1))
    chance: float = sum((sum(column) / (n * raters)) ** 2 for column in zip(*counts, strict=True))
    return None if chance == 1 else (alike - chance) / (1 - chance)
