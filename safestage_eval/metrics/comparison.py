"""Two policies, prompts or rule sets side by side, and whether the sample supports a difference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from safestage_eval.errors import InputError

from .interval import RESAMPLES
from .outcome import Outcome
from .paired import By, Paired, Pairs, holm, paired, pairs
from .power import ALPHA, Need, need


@dataclass(frozen=True)
class Line:
    """One difference, with its interval and tests.

    Attributes:
        of: the counts.
        interval: of the difference, 0…1; None with one task.
        p, p_holm: McNemar's exact test; adjusted for the stages, or the families, of one metric.
        need: the sample size that would show it; None when no pair differs.
    """

    of: Paired
    interval: tuple[float, float] | None
    p: float | None
    p_holm: float | None
    need: Need | None

    @property
    def significant(self) -> bool:
        """Whether the sample shows a difference: by the adjusted test and by the interval over tasks."""
        return (
            self.p_holm is not None
            and self.p_holm < ALPHA
            and self.interval is not None
            and not self.interval[0] <= 0 <= self.interval[1]
        )

    @property
    def reason(self) -> str:
        """Why a number is missing or meaningless; empty if none is."""
        if not self.of.n:
            return "no decided pairs"
        if len(self.of.tasks) < 2:
            return "one task: no interval over tasks"
        return "" if self.need else "no pair differs"


@dataclass(frozen=True)
class Comparison:
    """A and B on the same rollouts.

    Attributes:
        names: of A and of B.
        pairs: which rollouts belong together.
        lines: per scope and metric.
    """

    names: tuple[str, str]
    pairs: Pairs
    lines: tuple[Line, ...]


def compare(
    a: Sequence[Outcome],
    b: Sequence[Outcome],
    by: By,
    names: tuple[str, str],
    *,
    seed: int = 0,
    resamples: int = RESAMPLES,
) -> Comparison:
    """Pair, count, test and resample.

    Raises:
        InputError: nothing belongs together, or a side holds several policies that are to be
            compared as one.
    """
    if by != "rules":
        for side, name in ((a, names[0]), (b, names[1])):
            values = sorted({getattr(o, by) for o in side})
            if len(values) != 1:
                raise InputError(
                    name, f"it holds {len(values)} values of {by}: {', '.join(values) or 'none'}.",
                    "one", f"choose with --where {by}=…, or compare one file with --by {by}",
                )  # fmt: skip
    matched = pairs(a, b, by)
    counted = paired(matched)
    adjusted: dict[int, float] = {}
    for level, metric in {(c.level, c.metric) for c in counted}:
        own = [i for i, c in enumerate(counted) if (c.level, c.metric) == (level, metric) and c.n]
        values = holm([counted[i].p or 0.0 for i in own])
        adjusted.update(zip(own, values, strict=True))
    lines = tuple(
        Line(
            c,
            c.interval(seed, resamples),
            c.p,
            adjusted.get(i),
            need(c, seed, resamples) if c.n else None,
        )
        for i, c in enumerate(counted)
    )
    return Comparison(names, matched, lines)


def differs(a: Sequence[Outcome], b: Sequence[Outcome]) -> By:
    """Name what two sets of outcomes differ in: their policies, their prompts, or else the rules.

    Raises:
        InputError: several policies or prompts, only some of them the same.
    """
    sides = [
        tuple(sorted({getattr(o, name) for o in side}) for name in ("policy", "prompt"))
        for side in (a, b)
    ]
    (policies_a, prompts_a), (policies_b, prompts_b) = sides
    if (policies_a, prompts_a) == (policies_b, prompts_b):
        return "rules"
    if prompts_a == prompts_b and len(policies_a) == len(policies_b) == 1:
        return "policy"
    if policies_a == policies_b and len(prompts_a) == len(prompts_b) == 1:
        return "prompt"
    said = "; ".join(f"{', '.join(p)} under {', '.join(q)}" for p, q in sides)
    raise InputError(
        "both sides", f"they differ in more than one thing: {said}.",
        fix="say which with --by, and narrow them down with --where",
    )  # fmt: skip
