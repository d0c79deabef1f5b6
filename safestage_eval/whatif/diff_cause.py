"""Find the difference between two rule sets that made a verdict flip."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from safestage_eval.relations.vocabulary import GROUPS
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.meaning_differences import Meaning, Part, differences, mixed
from safestage_eval.rules.uses import calls

from .judge_again import Again

P = TypeVar("P")

MOST = 400
"""Combinations tried per flip; beyond, a set is found by leaving things out."""


@dataclass(frozen=True)
class Cause:
    """A smallest set of differences that flips a verdict.

    Attributes:
        parts: in words; switching exactly these flips it.
        alternatives: other sets of this size that flip it as well; as many as were tried.
        untried: size of the smallest sets that were not all tried; None where no smaller set than
            this one flips it, and all others of its size were tried.
    """

    parts: tuple[str, ...]
    alternatives: int = 0
    untried: int | None = None

    def __str__(self) -> str:
        """The differences in words, and the sets that were not tried."""
        said = " and ".join(self.parts)
        if self.alternatives:
            said += f" (so would {self.alternatives} other)"
        if self.untried is None:
            return said
        if self.untried == len(self.parts):
            return f"{said} (none of fewer; others of {self.untried} were not all tried)"
        return f"{said} (none can be left out; sets of {self.untried} or more were not all tried)"


def cause_of(before: Again, after: Again, code: str, wanted: str) -> Cause:
    """The smallest set of differences that takes a rule's verdict from the one to the other.

    One difference is switched at a time, then pairs, and so on, up to ``MOST`` combinations.

    Args:
        before: one episode under one rule set.
        after: the same under the other.
        code: of a rule that both have.
        wanted: the verdict afterwards.
    """
    trial = _Trial(before, after, code)
    return smallest(trial.parts, lambda chosen: trial.verdict(chosen) == wanted)


def smallest(parts: Sequence[P], flips: Callable[[Sequence[P]], bool], most: int = MOST) -> Cause:
    """The smallest set of parts that flips a verdict, and how surely it is the smallest.

    Args:
        parts: all of them together flip it.
        flips: whether some do.
        most: sets that are tried one size after another.
    """
    tried = 0
    for size in range(1, len(parts) + 1):
        hits: list[Sequence[P]] = []
        for chosen in itertools.combinations(parts, size):
            if tried == most:
                chosen_set = hits[0] if hits else _shrunk(parts, flips)
                return Cause(_shown(chosen_set), max(0, len(hits) - 1), size)
            tried += 1
            if flips(chosen):
                hits.append(chosen)
        if hits:
            return Cause(_shown(hits[0]), len(hits) - 1)
    return Cause(_shown(parts))


def _shrunk(parts: Sequence[P], flips: Callable[[Sequence[P]], bool]) -> Sequence[P]:
    """All parts, without those that can be left out, until none can."""
    kept, before = list(parts), len(parts) + 1
    while len(kept) < before:
        before = len(kept)
        for part in list(kept):
            fewer = [other for other in kept if other is not part]
            if fewer and flips(fewer):
                kept = fewer
    return kept


def _shown(parts: Sequence[object]) -> tuple[str, ...]:
    return tuple(map(str, parts))


class _Trial:
    """One rule on one episode, with any of the differences switched."""

    def __init__(self, before: Again, after: Again, code: str) -> None:
        self._sides = (before, after)
        old, new = (side.rules.scoped[code] for side in self._sides)
        self._old = Meaning(before.rules, old, before.binding.params(old))
        self._new = Meaning(after.rules, new, after.binding.params(new))
        self._players = tuple(
            side.binding.players(rule, side.episode.header)
            for side, rule in zip(self._sides, (old, new), strict=True)
        )
        self.parts: list[Part | str] = [*differences(self._old, self._new)]
        if self._players[0] != self._players[1]:
            self.parts.append("who plays the roles")
        if before.judge.success_time != after.judge.success_time:
            self.parts.append("when the goal counts as reached")

    def verdict(self, chosen: Sequence[Part | str]) -> str:
        """The verdict with the chosen differences switched."""
        meaning = mixed(self._old, self._new, [p for p in chosen if isinstance(p, Part)])
        rule = meaning.rule
        roles = {name for name, _ in rule.roles}
        if any(set(call.args) - roles - GROUPS.keys() for call in calls(rule)):
            return "senseless"  # an obligation of the one rule with the roles of the other
        if isinstance(rule, ast.Rule) and not rule.clauses:
            return "senseless"  # it asks for nothing
        swapped = "who plays the roles" in chosen
        bodies = {**self._players[not swapped], **self._players[swapped]}
        timed = self._sides["when the goal counts as reached" in chosen]
        players = {name: bodies.get(name, ()) for name in roles}
        return timed.mixed(self._sides, meaning.rules, rule, meaning.params, players).verdict
