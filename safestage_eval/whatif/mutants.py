"""Rules broken on purpose: which of the mistakes do the examples notice?

Mutation testing after DeMillo, Lipton and Sayward, "Hints on Test Data Selection" (Computer 11(4),
1978): a set of examples is worth as much as the mistakes that it tells from the rule as meant.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

from safestage_eval.errors import InputError
from safestage_eval.rules import RuleSet, rule_digest
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.uses import own_params

from .examples import Expected, Library, examples_of, outcome
from .mistakes import KINDS, Kind, mistakes


@dataclass(frozen=True)
class Mutant:
    """A rule with one mistake.

    Attributes:
        rule: code.
        kind: of mistake.
        what: the mistake, in words.
        rules: the rule set with it.
    """

    rule: str
    kind: Kind
    what: str
    rules: RuleSet


@dataclass(frozen=True)
class Hunted:
    """A mistake, and what became of it.

    Attributes:
        rule, kind, what: as of the mutant.
        killer: the example that tells it from the rule as meant; None if none does.
    """

    rule: str
    kind: Kind
    what: str
    killer: str | None


def mutants(rules: RuleSet, rule: ast.Rule, *, deep: bool = False) -> Iterator[Mutant]:
    """Every rule that differs by one mistake and means something else.

    Args:
        rules: the set that the rule belongs to.
        rule: as meant.
        deep: also mistakes in the states and phases that it rests on.
    """
    params = own_params(rules, rule)
    seen = {rule_digest(rules, rule, params)}
    for kind, what, changed in mistakes(rules, rule, deep=deep):
        mutated = changed.rules[rule.code]
        digest = rule_digest(changed, mutated, own_params(changed, mutated))
        if digest not in seen:
            seen.add(digest)
            yield Mutant(rule.code, kind, what, changed)


def hunt(
    rules: RuleSet,
    rule: ast.Rule,
    library: Library,
    *,
    kinds: Collection[str] = KINDS,
    deep: bool = False,
) -> list[Hunted]:
    """All mutants of a rule, each with the example that kills it.

    An example kills a mutant if it no longer comes out as it should. Examples that are missing or
    wrong to begin with kill nothing.

    Args:
        rules: the set that the rule belongs to.
        rule: as meant.
        library: where the examples are.
        kinds: of mistakes.
        deep: as for ``mutants``.
    """
    sound = _sound(rules, rule, library)
    found = []
    for mutant in mutants(rules, rule, deep=deep):
        if mutant.kind not in kinds:
            continue
        killer = next(
            (
                name
                for name, expected in sound
                if not _right(mutant.rules, rule.code, name, expected, library)
            ),
            None,
        )
        found.append(Hunted(mutant.rule, mutant.kind, mutant.what, killer))
    return found


def _sound(rules: RuleSet, rule: ast.Rule, library: Library) -> list[tuple[str, Expected]]:
    return [
        (name, expected)
        for name, expected in examples_of(rule)
        if _right(rules, rule.code, name, expected, library)
    ]


def _right(rules: RuleSet, code: str, name: str, expected: Expected, library: Library) -> bool:
    try:
        return outcome(library.judge(name, rules, rules.rules[code]), expected) == expected
    except InputError:
        return False
