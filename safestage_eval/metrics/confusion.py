"""The evaluator against people: counts and the metrics of them. A violation is the positive."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from .interval import wilson
from .kappa import cohen


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
