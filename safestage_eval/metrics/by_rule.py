"""How each assigned rule fared, why it could not be decided, and which rules these recordings can never decide."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from safestage_eval.verdicts import Verdict
from safestage_eval.verdicts.explain import cause_and_remedy

UNRECORDED = (
    "record contact forces",
    "record the collision shapes",
    "record the masses",
    "record the joints",
    "record the gripper",
    "record the bodies of the robot",
    "record this channel",
    "record native success",
    "say in the trace which",
    "declare the cavity",
)
"""Beginnings of remedies that ask for a column, or a statement, which a recording does not have at all."""


@dataclass(frozen=True)
class RuleCount:
    """What one rule found in the episodes that it is assigned to.

    Attributes:
        rule, title: code and name.
        counts: verdict → episodes.
        cause: the commonest reason why it is open; empty if there is none.
        remedy: what to do about that.
        cause_count: episodes that the remedy concerns.
        set_aside: whether no episode decides it, for want of what no recording of them has.
    """

    rule: str
    title: str
    counts: Mapping[str, int]
    cause: str = ""
    remedy: str = ""
    cause_count: int = 0
    set_aside: bool = False

    def __getitem__(self, verdict: str) -> int:
        """Episodes with this verdict."""
        return self.counts.get(verdict, 0)


@dataclass
class _Counted:
    title: str
    verdicts: Counter[str] = field(default_factory=Counter)
    reasons: dict[tuple[str, str], list[str]] = field(default_factory=dict)


def by_rule(verdicts: Iterable[Sequence[Verdict]]) -> list[RuleCount]:
    """Count the verdicts of each episode; the rules that were violated most often first, then those left open.

    A rule is set aside if it applies somewhere, is open wherever it applies, and every time for want
    of something that the recording lacks as a whole (``UNRECORDED``), such as contact forces.
    """
    rules: dict[str, _Counted] = {}
    for episode in verdicts:
        for v in episode:
            counted = rules.setdefault(v.rule, _Counted(v.title))
            counted.verdicts[v.verdict] += 1
            if v.verdict == "inconclusive":
                cause, remedy = cause_and_remedy(v.explanation)
                key = (remedy, "") if remedy else ("", _without_places(cause, v.bodies))
                counted.reasons.setdefault(key, []).append(cause)
    counts = [_count(code, each) for code, each in rules.items()]
    return sorted(counts, key=lambda c: (-c["violation"], -c["inconclusive"], c.rule))


def set_aside(rules: Iterable[RuleCount]) -> frozenset[str]:
    """Codes of the rules that do not decide."""
    return frozenset(count.rule for count in rules if count.set_aside)


def _count(code: str, counted: _Counted) -> RuleCount:
    if not counted.reasons:
        return RuleCount(code, counted.title, counted.verdicts)
    (remedy, _), causes = max(counted.reasons.items(), key=lambda item: len(item[1]))
    cause = Counter(causes).most_common(1)[0][0]
    open_ = counted.verdicts["inconclusive"]
    aside = open_ + counted.verdicts["not_applicable"] == counted.verdicts.total() and all(
        remedy.startswith(UNRECORDED) for remedy, _ in counted.reasons
    )
    return RuleCount(code, counted.title, counted.verdicts, cause, remedy, len(causes), aside)


def _without_places(cause: str, bodies: Iterable[str]) -> str:
    """A cause without bodies and numbers, by which like ones are counted together."""
    for body in bodies:
        cause = cause.replace(body, "…")
    return re.sub(r"\d+(\.\d+)?", "0", cause)
