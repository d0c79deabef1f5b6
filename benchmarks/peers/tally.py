"""Counts of comparisons with a peer's code, and of agreements."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safestage_eval.episode import Episode
from safestage_eval.rules import RuleSet
from safestage_eval.rules.episode_binding import bind_episode
from safestage_eval.verdicts.judging import Judge
from safestage_eval.verdicts.verdict import Verdict

Differences = Counter[str]


def verdicts(episode: Episode, rules: RuleSet) -> dict[str, Verdict]:
    """Rule → what it says of an episode, thinned ones included, whose velocities and poses may differ."""
    judge = Judge(episode, rules, bind_episode(rules, episode.header))
    found = {code: judge.verdict(rule) for code, rule in rules.rules.items()}
    costs = {code: judge.cost(cost)[1] for code, cost in rules.costs.items()}
    return found | {code: verdict for code, verdict in costs.items() if verdict is not None}


@dataclass
class Count:
    """Comparisons of one rule, signal or relation with one function of a peer."""

    run: int = 0
    agreed: int = 0
    differences: Differences = field(default_factory=Counter)


@dataclass
class Tally:
    """Counts by what was compared: (ours, theirs, unit).

    Attributes:
        ran: folder of traces → how many of them; ``examples`` → how many scenes.
    """

    counts: dict[tuple[str, str, str], Count] = field(default_factory=dict)
    ran: Counter[str] = field(default_factory=Counter)

    def count(self, ours: str, theirs: str, unit: str) -> Count:
        """The count of one comparison; ``unit`` is what is counted: frames, verdicts, values."""
        return self.counts.setdefault((ours, theirs, unit), Count())

    def verdict(
        self, ours: Verdict | str, theirs: bool, rule: str, function: str, why: str
    ) -> None:
        """One verdict of ours beside one of theirs (True: violated); ``why`` if they differ."""
        said = ours if isinstance(ours, str) else ours.verdict
        if said in ("inconclusive", "not_applicable"):
            if said == "inconclusive":
                self.count(rule, function, "verdicts").differences["inconclusive here"] += 1
                self.count(rule, function, "verdicts").run += 1
            return
        one = self.count(rule, function, "verdicts")
        one.run += 1
        if (said == "violation") == theirs:
            one.agreed += 1
        else:
            one.differences[f"{why}: {'only there' if theirs else 'only here'}"] += 1

    def frames(
        self, ours: NDArray[Any], theirs: NDArray[Any], rule: str, function: str,
        reasons: Iterable[tuple[str, NDArray[np.bool_]]] = (),
    ) -> None:  # fmt: skip
        """Truth frame by frame: ours (T,) 1, 0 or NaN where it is not known, theirs (T,) bool.

        A difference is counted under the first of the ``reasons`` that holds there.
        """
        one = self.count(rule, function, "frames")
        known = ~np.isnan(ours)
        one.run += len(ours)
        same = known & ((ours > 0.5) == theirs)
        one.agreed += int(same.sum())
        left = ~same
        for why, where in (("unknown here", ~known), *reasons):
            one.differences[why] += int((left & where).sum())
            left = left & ~where
        one.differences["unexplained, only here"] += int((left & (ours > 0.5)).sum())
        one.differences["unexplained, only there"] += int((left & theirs).sum())
        one.differences += Counter()  # drops what is zero

    def values(
        self, ours: NDArray[Any], theirs: NDArray[Any], rule: str, function: str, within: float
    ) -> None:
        """Numbers that have to agree to so much, absolute."""
        one = self.count(rule, function, "values")
        same = np.abs(np.asarray(ours) - np.asarray(theirs)) <= within
        same |= np.isnan(ours) & np.isnan(theirs)
        one.run += same.size
        one.agreed += int(same.sum())
        if not same.all():
            one.differences[f"more than {within:g} apart"] += int((~same).sum())

    def add(self, other: Tally) -> None:
        """Sum."""
        for key, count in other.counts.items():
            mine = self.count(*key)
            mine.run += count.run
            mine.agreed += count.agreed
            mine.differences += count.differences

    def rows(self) -> list[tuple[str, ...]]:
        """Rule, function, run, agreed, differences; sorted. Rules that agree with one function throughout share a row."""
        shared: dict[tuple[str, str], list[str]] = {}
        for (ours, theirs, unit), count in sorted(self.counts.items()):
            if not count.differences:
                shared.setdefault((theirs, unit), []).append(ours)
        rows = []
        for (ours, theirs, unit), count in sorted(self.counts.items()):
            with_it = [ours] if count.differences else shared.pop((theirs, unit), [])
            if with_it:
                counts = [self.counts[one, theirs, unit] for one in with_it]
                rows.append((
                    "; ".join(with_it), theirs, f"{sum(c.run for c in counts):,} {unit}",
                    f"{sum(c.agreed for c in counts):,}",
                    "; ".join(f"{n:,} {why}" for why, n in count.differences.most_common()),
                ))  # fmt: skip
        return rows
