"""Rules broken on purpose: which of the mistakes do the examples notice?

Mutation testing after DeMillo, Lipton and Sayward, "Hints on Test Data Selection" (Computer 11(4),
1978): a set of examples is worth as much as the mistakes that it tells from the rule as meant.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass

from safestage_eval.rules import RuleSet, rule_digest
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import digest_of, reached
from safestage_eval.rules.uses import own_params

from .examples import Expected, Library, deciding
from .mistakes import mistakes, mistakes_in
from .tree_mistakes import KINDS, Kind


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


def mutants(rules: RuleSet, rule: ast.Scoped) -> Iterator[Mutant]:
    """Every rule that differs by one mistake and means something else.

    Args:
        rules: the set that the rule, or cost, belongs to.
        rule: as meant.
    """
    params = own_params(rules, rule)
    seen = {rule_digest(rules, rule, params)}
    for kind, text, changed in mistakes(rules, rule):
        mutated = changed.scoped[rule.code]
        digest = rule_digest(changed, mutated, own_params(changed, mutated))
        if digest not in seen:
            seen.add(digest)
            yield Mutant(rule.code, kind, text, changed)


def mutants_in(rules: RuleSet, name: str) -> Iterator[Mutant]:
    """Every rule set in which a definition differs by one mistake and means something else."""

    def digest(some: RuleSet) -> str:
        kinds = (some.states, some.phases, some.signals, some.derived)
        definition = next(one[name] for one in kinds if name in one)
        return digest_of(some, definition, some.params)

    seen = {digest(rules)}
    for kind, text, changed in mistakes_in(rules, name):
        if digest(changed) not in seen:
            seen.add(digest(changed))
            yield Mutant(name, kind, text, changed)


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
    right = library.right(rules, rule)
    return [
        Hunted(m.where, m.kind, m.what, _killer(m.rules, rule.code, right, library), bool(right))
        for m in mutants(rules, rule)
        if m.kind in kinds
    ]


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
        (i, rule.code, example, expected)
        for i, rules in enumerate(sets)
        for rule in resting_on(rules, name)
        for example, expected in library.right(rules, rule)
    ]
    hunted = []
    for mutant, *others in zip(*(mutants_in(rules, name) for rules in sets), strict=True):
        if mutant.kind not in kinds:
            continue
        killer = None
        for n, (i, code, example, expected) in enumerate(examples):
            if not library.comes_out((mutant, *others)[i].rules, code, example, expected):
                killer = example
                examples.insert(0, examples.pop(n))  # it may well notice the next mistake too
                break
        hunted.append(Hunted(name, mutant.kind, mutant.what, killer, bool(examples)))
    return hunted


def resting_on(rules: RuleSet, name: str) -> list[ast.Scoped]:
    """The rules, and costs with a budget, that use a definition, directly or not."""
    keys = {f"{kind}.{name}" for kind in ("state", "phase", "signal")}
    return [
        rule
        for rule in deciding(rules).values()
        if not keys.isdisjoint(reached(rules, rule, rules.params))
    ]


def _killer(
    rules: RuleSet, code: str, right: Sequence[tuple[str, Expected]], library: Library
) -> str | None:
    return next(
        (n for n, expected in right if not library.comes_out(rules, code, n, expected)), None
    )
