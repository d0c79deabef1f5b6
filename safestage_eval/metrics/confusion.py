"""The evaluator against people: counts and the metrics of them. A violation is the positive."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from .interval import wilson


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
    n = sum(map(sum, table))
    if not n:
        return None
    alike = sum(table[i][i] for i in range(len(table)))
    rows, columns = (
        [sum(row) for row in table],
        [sum(column) for column in zip(*table, strict=True)],
    )
    chance = sum(a * b for a, b in zip(rows, columns, strict=True))
    if chance == n * n:
        return None
    return float((n * alike - chance) / (n * n - chance))


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
