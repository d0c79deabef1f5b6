"""Rules broken on purpose: which of the mistakes do the examples notice?

Mutation testing after DeMillo, Lipton and Sayward, "Hints on Test Data Selection" (Computer 11(4),
1978): a set of examples is worth as much as the mistakes that it tells from the rule as meant.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from safestage_eval.formats import EpisodeRef
from safestage_eval.rules import RuleSet, rule_digest
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import digest_of, reached
from safestage_eval.rules.uses import own_params

from .each_episode import Progress, each
from .examples import Checked, Expected, Library, Suite, check_rule, deciding, suite
from .mistakes import KINDS, Kind, Mistake, mistakes, mistakes_in

WORTH = 12
"""Rules below which starting worker processes costs more than it saves."""

Example = tuple[int, str, str, Expected]
"""Place of a rule set, code of its rule, name of the example and what is expected of it."""


@dataclass(frozen=True)
class Mutant:
    """A rule set with one mistake.

    Attributes:
        where: code of the rule or cost that has it, or name of the definition.
        kind: of mistake.
        what: the mistake, in words.
        rules: the rule set with it.
    """

    where: str
    kind: Kind
    what: str
    rules: RuleSet


@dataclass(frozen=True)
class Hunted:
    """A mistake, and what became of it.

    Attributes:
        where, kind, what: as of the mutant.
        killer: the example that tells it from the rule as meant; None if none does.
        tested: whether there was an example to try: one that comes out as it should.
    """

    where: str
    kind: Kind
    what: str
    killer: str | None
    tested: bool


def mutants(rules: RuleSet, rule: ast.Scoped) -> list[Mutant]:
    """Every rule that differs by one mistake and means something else.

    Args:
        rules: the set that the rule, or cost, belongs to.
        rule: as meant.
    """

    def digest(some: RuleSet) -> str:
        own = some.scoped[rule.code]
        return rule_digest(some, own, own_params(some, own))

    return [*_different(rules, rule.code, mistakes(rules, rule), digest)]


def mutants_in(rules: RuleSet, name: str) -> list[Mutant]:
    """Every rule set in which a definition differs by one mistake and means something else."""

    def digest(some: RuleSet) -> str:
        kinds = (some.states, some.phases, some.signals, some.derived)
        return digest_of(some, next(one[name] for one in kinds if name in one), some.params)

    return [*_different(rules, name, mistakes_in(rules, name), digest)]


def _different(
    rules: RuleSet, where: str, made: Iterable[Mistake], digest: Callable[[RuleSet], str]
) -> Iterator[Mutant]:
    """The mistakes that each mean something else than the rules, and than those before."""
    seen = {digest(rules)}
    for kind, text, changed in made:
        meaning = digest(changed)
        if meaning not in seen:
            seen.add(meaning)
            yield Mutant(where, kind, text, changed)


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
    rules: RuleSet, rule: ast.Scoped, library: Library, *, kinds: Collection[str] = KINDS
) -> list[Hunted]:
    """All mutants of a rule, each with the example that kills it.

    An example kills a mutant if it no longer comes out as it should. Examples that are missing or
    wrong to begin with kill nothing.

    Args:
        rules: the set that the rule, or cost, belongs to.
        rule: as meant.
        library: where the examples are.
        kinds: of mistakes.
    """
    examples = [(0, rule.code, *example) for example in library.right(rules, rule)]
    return _hunted(zip(mutants(rules, rule), strict=True), examples, library, kinds)


def hunt_in(
    sets: Sequence[RuleSet], name: str, library: Library, *, kinds: Collection[str] = KINDS
) -> list[Hunted]:
    """All mutants of a definition, each with an example of any rule that kills it.

    A definition stands in one place, and many rules may rest on it: whichever of them has an
    example that no longer comes out as it should notices the mistake.

    Args:
        sets: rule sets that declare it alike.
        name: of the state, phase or variant of a signal.
        library: where the examples are.
        kinds: of mistakes.
    """
    examples = [
        (i, rule.code, *example)
        for i, rules in enumerate(sets)
        for rule in resting_on(rules, name)
        for example in library.right(rules, rule)
    ]
    made = zip(*(mutants_in(rules, name) for rules in sets), strict=True)
    return _hunted(made, examples, library, kinds)


def _hunted(
    made: Iterable[tuple[Mutant, ...]],
    examples: list[Example],
    library: Library,
    kinds: Collection[str],
) -> list[Hunted]:
    """Each mutant, as it stands in one or more rule sets, with the example that kills it."""
    hunted = []
    for some in made:
        where, kind, what = some[0].where, some[0].kind, some[0].what
        if kind not in kinds:
            continue
        kills = (one for one in examples if not library.comes_out(some[one[0]].rules, *one[1:]))
        killer = next(kills, None)
        if killer is not None:  # it may well notice the next mistake too
            examples = [killer, *(one for one in examples if one is not killer)]
        name = None if killer is None else killer[2]
        hunted.append(Hunted(where, kind, what, name, bool(examples)))
    return hunted


def resting_on(rules: RuleSet, name: str) -> list[ast.Scoped]:
    """The rules, and costs with a budget, that use a definition, directly or not."""
    keys = {f"{kind}.{name}" for kind in ("state", "phase", "signal")}
    return [
        rule
        for rule in deciding(rules).values()
        if not keys.isdisjoint(reached(rules, rule, rules.params))
    ]


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
