"""Rules broken on purpose: which of the mistakes do the examples notice?

Mutation testing after DeMillo, Lipton and Sayward, "Hints on Test Data Selection" (Computer 11(4),
1978): a set of examples is worth as much as the mistakes that it tells from the rule as meant.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from safestage_eval.formats import EpisodeRef
from safestage_eval.rules import RuleSet, rule_digest
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import digest_of, reached
from safestage_eval.rules.uses import own_params

from .each_episode import Progress, each
from .examples import Checked, Library, Suite, check_rule, deciding, suite
from .mistakes import KINDS, Kind, Mistake, definition, mistakes

WORTH = 12
"""Rules below which starting worker processes costs more than it saves."""


@dataclass(frozen=True)
class Hunted:
    """A mistake, and what became of it.

    Attributes:
        where: code of the rule or cost that has it, or name of the definition.
        kind, what: as of the mistake.
        killer: the example that tells it from the rule as meant; None if none does.
        tested: whether there was an example to try: one that comes out as it should.
    """

    where: str
    kind: Kind
    what: str
    killer: str | None
    tested: bool


def mutants(rules: RuleSet, name: str) -> list[Mistake]:
    """The mistakes in a rule, cost or definition that mean something else than it, and than those before."""
    seen, out = {_meaning(rules, name)}, []
    for mistake in mistakes(rules, name):
        meaning = _meaning(mistake.changed, name)
        if meaning not in seen:
            seen.add(meaning)
            out.append(mistake)
    return out


def _meaning(rules: RuleSet, name: str) -> str:
    rule = rules.scoped.get(name)
    if rule is not None:
        return rule_digest(rules, rule, own_params(rules, rule))
    return digest_of(rules, definition(rules, name)[1], rules.params)


def definitions(rules: RuleSet) -> dict[str, object]:
    """Name → every state, phase and variant that a rule, or a cost with a budget, rests on."""
    used = {}
    for rule in deciding(rules).values():
        for key, value in reached(rules, rule, rules.params).items():
            kind, _, name = key.partition(".")
            if kind in ("state", "phase", "signal"):
                used[name] = value
    return used


def hunt(
    sets: Sequence[RuleSet], name: str, library: Library, *, kinds: Collection[str] = KINDS
) -> list[Hunted]:
    """All mutants of a rule, cost or definition, each with the example that kills it.

    An example kills a mutant if it no longer comes out as it should. Examples that are missing or
    wrong to begin with kill nothing. A definition stands in one place, and many rules may rest on
    it: an example of any of them may notice the mistake.

    Args:
        sets: rule sets that declare it alike.
        name: code, or name of the state, phase or signal.
        library: where the examples are.
        kinds: of mistakes.
    """
    examples = [
        (i, rule.code, *example)
        for i, rules in enumerate(sets)
        for rule in resting_on(rules, name)
        for example in library.right(rules, rule)
    ]
    hunted = []
    for some in zip(*(mutants(rules, name) for rules in sets), strict=True):
        kind, what = some[0].kind, some[0].what
        if kind not in kinds:
            continue
        kills = (one for one in examples if not library.comes_out(some[one[0]].changed, *one[1:]))
        killer = next(kills, None)
        if killer is not None:  # it may well notice the next mistake too
            examples = [killer, *(one for one in examples if one is not killer)]
        killed_by = None if killer is None else killer[2]
        hunted.append(Hunted(name, kind, what, killed_by, bool(examples)))
    return hunted


def resting_on(rules: RuleSet, name: str) -> list[ast.Scoped]:
    """The rules, and costs with a budget, that use a definition, directly or not; of a code that rule."""
    if name in rules.scoped:
        return [rules.scoped[name]]
    keys = {f"{kind}.{name}" for kind in ("state", "phase", "signal")}
    return [
        rule
        for rule in deciding(rules).values()
        if not keys.isdisjoint(reached(rules, rule, rules.params))
    ]


_Task = tuple[tuple[str, ...], str]
"""Names of the rule sets that share a rule, cost or definition, and its code or name."""


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
        sets, name = [self.sets[one] for one in task[0]], task[1]
        rule = sets[0].scoped.get(name)
        checked = [] if rule is None else check_rule(sets[0], rule, self._library)
        return checked, hunt(sets, name, self._library, kinds=self.kinds) if self.kinds else []


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
    todo: list[_Task] = [((name,), c) for name, rules in filled.items() for c in deciding(rules)]
    if deep and kinds:
        todo += _shared(filled)
    work = _Work(filled, recorded, kinds)
    results = list(
        zip(todo, each(todo, work, jobs=jobs, worth=WORTH, progress=progress), strict=True)
    )
    suites = {
        name: suite(
            rules, (c for task, (cs, _) in results if task[0][0] == name for c in cs), least
        )
        for name, rules in filled.items()
    }
    hunted = {
        name: [m for task, (_, ms) in results if task[0][0] == name for m in ms] for name in filled
    }
    return suites, hunted


def _shared(sets: Mapping[str, RuleSet]) -> list[_Task]:
    """One task for each definition that rules rest on; sets that declare it alike share it."""
    sharing: dict[tuple[str, object, str], list[str]] = {}
    for name, rules in sets.items():
        for defined, meaning in definitions(rules).items():
            key = (defined, meaning, digest_of(rules, meaning, rules.params))
            sharing.setdefault(key, []).append(name)
    return [(tuple(names), defined) for (defined, *_), names in sharing.items()]
