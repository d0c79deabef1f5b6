"""All examples of several rule sets, and their rules broken on purpose, in several processes."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from safestage_eval.formats import EpisodeRef
from safestage_eval.rules import RuleSet

from .examples import Checked, Library, Suite, check_rule, suite
from .many import Progress, each
from .mutants import Hunted, hunt

WORTH = 12
"""Rules below which starting worker processes costs more than it saves."""


@dataclass
class _Work:
    """What a process has at hand: the rule sets, and the examples that it has opened."""

    sets: Mapping[str, RuleSet]
    recorded: Sequence[EpisodeRef]
    kinds: Collection[str]
    deep: bool
    _library: Library | None = field(default=None, repr=False)

    def __call__(self, which: tuple[str, str]) -> tuple[list[Checked], list[Hunted]]:
        """The examples of one rule, and its mistakes, given its set and code."""
        if self._library is None:
            self._library = Library(self.recorded)
        rules = self.sets[which[0]]
        rule = rules.rules[which[1]]
        checked = check_rule(rules, rule, self._library)
        if not self.kinds:
            return checked, []
        return checked, hunt(rules, rule, self._library, kinds=self.kinds, deep=self.deep)


def check_sets(
    sets: Mapping[str, RuleSet],
    recorded: Sequence[EpisodeRef] = (),
    *,
    least: int = 2,
    kinds: Collection[str] = (),
    deep: bool = False,
    jobs: int | None = None,
    progress: Progress | None = None,
) -> tuple[dict[str, Suite], dict[str, list[Hunted]]]:
    """Judge the examples of every rule of every set.

    Args:
        sets: name → rule set.
        recorded: stored episodes that examples may name by their ids.
        least: how many violating and how many passing examples each rule must have.
        kinds: of mistakes to make in each rule; none if empty.
        deep: mistakes in the states that a rule rests on as well.
        jobs: worker processes.
        progress: told (done, total) after each rule.

    Returns:
        Name → what became of the examples, and of the mistakes.
    """
    todo = [(name, code) for name, rules in sets.items() for code in rules.rules]
    work = _Work(sets, recorded, kinds, deep)
    found = dict(
        zip(todo, each(todo, work, jobs=jobs, worth=WORTH, progress=progress), strict=True)
    )
    suites = {
        name: suite(rules, (c for code in rules.rules for c in found[name, code][0]), least)
        for name, rules in sets.items()
        if rules.rules
    }
    hunted = {
        name: [m for code in rules.rules for m in found[name, code][1]]
        for name, rules in sets.items()
        if rules.rules
    }
    return suites, hunted
