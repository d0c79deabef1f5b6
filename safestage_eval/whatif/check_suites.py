"""Check the examples of several rule sets, and hunt mistakes in their rules, in several processes."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from safestage_eval.formats import EpisodeRef
from safestage_eval.rules import RuleSet
from safestage_eval.rules.digest import digest_of

from .each_episode import Progress, each
from .examples import Checked, Library, Suite, check_rule, deciding, suite
from .mutants import Hunted, definitions, hunt, hunt_in

WORTH = 12
"""Rules below which starting worker processes costs more than it saves."""


@dataclass(frozen=True)
class _Task:
    """The examples of one rule and its mistakes, or the mistakes in one definition.

    Attributes:
        sets: names of the rule sets; several where they share a definition.
        code: of the rule or cost; None for a definition.
        name: of the state or phase.
    """

    sets: tuple[str, ...]
    code: str | None = None
    name: str = ""


@dataclass
class _Work:
    """The work of one process on a task, with the rule sets and the examples that it has opened."""

    sets: Mapping[str, RuleSet]
    recorded: Sequence[EpisodeRef]
    kinds: Collection[str]
    _library: Library | None = field(default=None, repr=False)

    def __call__(self, task: _Task) -> tuple[list[Checked], list[Hunted]]:
        if self._library is None:
            self._library = Library(self.recorded)
        sets = [self.sets[name] for name in task.sets]
        if task.code is None:
            return [], hunt_in(sets, task.name, self._library, kinds=self.kinds)
        rule = sets[0].scoped[task.code]
        checked = check_rule(sets[0], rule, self._library)
        if not self.kinds:
            return checked, []
        return checked, hunt(sets[0], rule, self._library, kinds=self.kinds)


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
    """Judge the examples of every rule, and every cost with a budget, of every set.

    Args:
        sets: name → rule set.
        recorded: stored episodes that examples may name by their ids.
        least: how many violating and how many passing examples each rule must have.
        kinds: of mistakes to make in each rule; none if empty.
        deep: mistakes in the states and phases that rules rest on as well. Each is made once, and
            may be noticed by any rule of any of the sets that declare it alike.
        jobs: worker processes.
        progress: called with (done, total) after each rule and definition.

    Returns:
        Name → outcome of the examples, and of the mistakes; mistakes in a definition that several
        sets share are listed under the first of them.
    """
    filled = {name: rules for name, rules in sets.items() if deciding(rules)}
    todo = [_Task((name,), code) for name, rules in filled.items() for code in deciding(rules)]
    if deep and kinds:
        todo += _shared(filled)
    work = _Work(filled, recorded, kinds)
    results = list(
        zip(todo, each(todo, work, jobs=jobs, worth=WORTH, progress=progress), strict=True)
    )
    suites = {
        name: suite(
            rules, (c for task, (cs, _) in results if task.sets[0] == name for c in cs), least
        )
        for name, rules in filled.items()
    }
    hunted = {
        name: [m for task, (_, ms) in results if task.sets[0] == name for m in ms]
        for name in filled
    }
    return suites, hunted


def _shared(sets: Mapping[str, RuleSet]) -> list[_Task]:
    """One task for each definition that rules rest on; sets that declare it alike share it."""
    sharing: dict[tuple[str, object, str], list[str]] = {}
    for name, rules in sets.items():
        for defined, meaning in definitions(rules).items():
            key = (defined, meaning, digest_of(rules, meaning, rules.params))
            sharing.setdefault(key, []).append(name)
    return [_Task(tuple(names), name=defined) for (defined, *_), names in sharing.items()]
