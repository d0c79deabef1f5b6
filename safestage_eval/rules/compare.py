"""The differences of two rule sets: rules, obligations, limits, parameters, and which meanings differ."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from . import syntax as ast
from .digest import reached, rule_digest
from .meaning_differences import Meaning, Part, differences, value_text
from .uses import own_params


@dataclass(frozen=True)
class Comparison:
    """Two rule sets side by side.

    Attributes:
        added, removed: code → title.
        changed: code of each rule that means something else → what differs.
        same: codes that mean the same.
        digests: code → digest before and after, of the changed ones.
        unread: parameters that differ and that no rule of both sets reads.
        others: goals that come, go or say something else, in words.
    """

    added: Mapping[str, str]
    removed: Mapping[str, str]
    changed: Mapping[str, tuple[Part, ...]]
    same: tuple[str, ...]
    digests: Mapping[str, tuple[str, str]]
    unread: tuple[Part, ...]
    others: tuple[str, ...] = ()

    @property
    def empty(self) -> bool:
        """Every rule and goal means the same in both."""
        return not (self.added or self.removed or self.changed or self.others)

    def shared(self) -> dict[Part, list[str]]:
        """Each difference → the rules that it reaches, those of several rules first."""
        codes: dict[Part, list[str]] = {}
        for code, parts in self.changed.items():
            for part in parts:
                if part.kind in ("param", "material", "state", "phase", "signal", "baseline"):
                    codes.setdefault(part, []).append(code)
        return codes

    def own(self) -> dict[str, list[Part]]:
        """Code → what differs in the rule itself."""
        shared = self.shared()
        own = {
            code: [part for part in parts if part not in shared]
            for code, parts in self.changed.items()
        }
        return {code: parts for code, parts in own.items() if parts}


def compare(before: ast.RuleSet, after: ast.RuleSet) -> Comparison:
    """Compare two rule sets by the codes of their rules and costs."""
    old, new = before.scoped, after.scoped
    changed, same, digests = {}, [], {}
    for code in old.keys() & new.keys():
        a = Meaning(before, old[code], own_params(before, old[code]))
        b = Meaning(after, new[code], own_params(after, new[code]))
        marks = (rule_digest(a.rules, a.rule, a.params), rule_digest(b.rules, b.rule, b.params))
        if marks[0] == marks[1]:
            same.append(code)
            continue
        changed[code], digests[code] = tuple(differences(a, b)), marks
    named = {part.name for parts in changed.values() for part in parts if part.kind == "param"}
    unread = [
        Part("param", name, value_text(before.params.get(name)), value_text(after.params.get(name)))
        for name in sorted(before.params.keys() | after.params.keys())
        if name not in named and before.params.get(name) != after.params.get(name)
    ]
    return Comparison(
        {code: new[code].title for code in sorted(new.keys() - old.keys())},
        {code: old[code].title for code in sorted(old.keys() - new.keys())},
        dict(sorted(changed.items())),
        tuple(sorted(same)),
        dict(sorted(digests.items())),
        tuple(unread),
        tuple(_others(before, after)),
    )


def _others(before: ast.RuleSet, after: ast.RuleSet) -> Iterator[str]:
    old, new = _reaching(before), _reaching(after)
    for name in sorted(old.keys() | new.keys()):
        if old.get(name) != new.get(name):
            change = "changed" if name in old and name in new else "added"
            yield f"goal {name} {change if name in new else 'left out'}"


def _reaching(rules: ast.RuleSet) -> dict[str, Any]:
    """Each goal with everything that it reaches."""
    return {
        name: (goal, sorted(reached(rules, goal, rules.params).items(), key=lambda item: item[0]))
        for name, goal in rules.goals.items()
    }
