"""What differs between two meanings of a rule, rules with some differences applied, and two rule sets side by side.

A meaning is laid out flat: each definition and each part of the rule under its kind and name. What differs is then the
entries that do, and a rule that is partly one and partly the other is made of entries of both.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from . import syntax as ast
from . import syntax_words
from .clauses import CLAUSES
from .digest import reached, rule_digest
from .uses import own_params

Key = tuple[str, str]
"""``("param", "min_clearance")``, ``("material", "mug.max_tilt")``, ``("require", "tilt(target)")``, …."""

_DEFINED = ("param", "material", "state", "phase", "signal", "baseline")
"""Kinds that several rules share, in the order of lists."""

_LISTED = [kind for kind, clause in CLAUSES.items() if clause.value != "alternative"]
"""Obligations whose entries are parts of their own."""

_WORDS: dict[str, str] = {
    **{kind: clause.heading for kind, clause in CLAUSES.items()},
    "given": "only if", "during": "judged during", "at": "judged at",
}  # fmt: skip

_FIELDS = [
    *(kind for kind in CLAUSES if kind not in _LISTED),
    *("given", "during", "at", "until", "for_", "roles"),
]

_ORDER = [*_DEFINED, "cost", *_LISTED, *(field.rstrip("_") for field in _FIELDS)]


@dataclass(frozen=True)
class Part:
    """One thing that differs between two meanings of a rule.

    Attributes:
        kind, name: ``param``, ``min_clearance``; ``require``, ``tilt(target)``; ….
        before, after: in words; None where it is missing.
    """

    kind: str
    name: str
    before: str | None = None
    after: str | None = None

    @property
    def label(self) -> str:
        """The name of the part in reports: a parameter by its name alone."""
        if self.kind == "param":
            return self.name
        return f"{_WORDS.get(self.kind, self.kind)} {self.name}".strip()

    def __str__(self) -> str:
        """``min_clearance 8 cm → 10 cm``; ``never contact(a, b) added``."""
        if self.before is None:
            said = f" ({self.after})" if self.kind not in _LISTED else ""
            return f"{self.label} added{said}"
        if self.after is None:
            return f"{self.label} left out"
        return f"{self.label}: {self.before} → {self.after}"


@dataclass(frozen=True)
class Meaning:
    """A rule as it holds: with the set that it belongs to and the values of its parameters."""

    rules: ast.RuleSet
    rule: ast.Scoped
    params: ast.Params


def differences(before: Meaning, after: Meaning) -> list[Part]:
    """Everything that differs between two meanings of a rule and may move its verdicts."""
    old, new = _flat(before, after), _flat(after, before)
    reads = [reached(side.rules, side.rule, side.params) for side in (before, after)]
    named = dict.fromkeys([*reads[0], *reads[1], "baseline."])
    used = {tuple(name.split(".", 1)): place for place, name in enumerate(named)}

    def place(key: Key) -> tuple[int, int]:
        return _ORDER.index(key[0]), used.get((key[0], key[1].rpartition(".")[2]), 0)

    parts = []
    for key in sorted({**old, **new}, key=place):
        kind, name = key
        of_use = kind not in _DEFINED or (kind, name.rpartition(".")[2]) in used
        if of_use and old.get(key) != new.get(key):
            said = [_said(key, old.get(key), before), _said(key, new.get(key), after)]
            if kind == "cost" and said[0] == said[1]:
                said = ["as it was", "as it is"]
            parts.append(Part(kind, name, *said))
    return parts


def mixed(before: Meaning, after: Meaning, chosen: Collection[Part]) -> Meaning:
    """The rule as before, but with some parts as after."""
    old, new = _flat(before, after), _flat(after, before)
    keys = {(part.kind, part.name) for part in chosen}
    # what only the other set defines does no harm, but for rows of materials, which come before the default
    flat = {key: node for key, node in new.items() if key[0] in _DEFINED and not _row(key)}
    flat |= {key: node for key, node in old.items() if key not in keys}
    flat |= {key: node for key, node in new.items() if key in keys}
    named: dict[str, dict[str, Any]] = {}
    for (kind, name), node in flat.items():
        named.setdefault(kind, {})[name] = node
    materials: dict[str, dict[str, ast.Quantity]] = {"default": {}}
    for name, cell in named.get("material", {}).items():
        material, column = name.split(".")
        materials.setdefault(material, {})[column] = cell
    signals = named.get("signal", {})
    rule: ast.Scoped = named["cost"][""] if "cost" in named else _rule(before.rule, named)
    rules = replace(
        before.rules,
        materials=materials,
        signals={name: one for name, one in signals.items() if isinstance(one, ast.SignalDef)},
        states=named.get("state", {}),
        phases=named.get("phase", {}),
        baseline=flat["baseline", ""],
        derived={name: one for name, one in signals.items() if isinstance(one, ast.DerivedDef)},
    ).with_scoped(rule)
    return Meaning(rules, rule, named.get("param", {}))


def _row(key: Key) -> bool:
    return key[0] == "material" and not key[1].startswith("default.")


def _flat(side: Meaning, other: Meaning) -> dict[Key, Any]:
    """All that a meaning is made of; a cost, or a rule beside one, is a single part."""
    rules, rule = side.rules, side.rule
    flat: dict[Key, Any] = {("baseline", ""): rules.baseline}
    for kind, named in (
        ("param", side.params), ("state", rules.states), ("phase", rules.phases),
        ("signal", {**rules.signals, **rules.derived}),
    ):  # fmt: skip
        flat |= {(kind, name): node for name, node in named.items()}
    for material, row in rules.materials.items():
        flat |= {("material", f"{material}.{column}"): cell for column, cell in row.items()}
    if isinstance(rule, ast.Cost) or isinstance(other.rule, ast.Cost):
        return flat | {("cost", ""): replace(rule, title="", set=())}
    fields = {(field.rstrip("_"), ""): getattr(rule, field) for field in _FIELDS}
    flat |= {key: node for key, node in fields.items() if node is not None}
    for kind in _LISTED:
        for item in CLAUSES[kind].entries(getattr(rule, kind)):
            name = unique = _name(item)
            count = 2
            while (kind, unique) in flat:  # a second one of the same name is numbered
                unique, count = f"{name} ({count})", count + 1
            flat[kind, unique] = item
    return flat


def _rule(like: ast.Scoped, named: Mapping[str, Mapping[str, Any]]) -> ast.Scoped:
    """A rule of its parts."""
    changes: dict[str, Any] = {f: named.get(f.rstrip("_"), {}).get("") for f in _FIELDS}
    for kind in _LISTED:
        items: Any = tuple(named.get(kind, {}).values())
        if CLAUSES[kind].value == "condition":
            items = ast.Condition(items) if items else None
        changes[kind] = items
    return replace(like, **changes)


def _name(item: Any) -> str:
    """What an entry is about: its call without the limit, so that a limit can change."""
    if isinstance(item, ast.Condition) and len(item.atoms) == 1:
        item = item.atoms[0]
    if isinstance(item, ast.SignalAtom):
        return syntax_words.measured(item)
    if isinstance(item, ast.StateAtom | ast.CountAtom):
        return str(item.call)
    return syntax_words.anything(item, {})


def _said(key: Key, node: Any, side: Meaning) -> str | None:
    """A part in words, an entry without the name that it is listed under; None where it is missing."""
    if node is None:
        return None
    said = syntax_words.anything(node, side.params)
    return said.removeprefix(key[1]).strip() or said if key[0] in _LISTED else said


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
        """Each difference in what rules share → the rules that it reaches."""
        codes: dict[Part, list[str]] = {}
        for code, parts in self.changed.items():
            for part in parts:
                if part.kind in _DEFINED:
                    codes.setdefault(part, []).append(code)
        return codes

    def own(self) -> dict[str, list[Part]]:
        """Code → what differs in the rule itself."""
        own = {c: [p for p in parts if p.kind not in _DEFINED] for c, parts in self.changed.items()}
        return {code: parts for code, parts in own.items() if parts}


def compare(before: ast.RuleSet, after: ast.RuleSet) -> Comparison:
    """Compare two rule sets by the codes of their rules and costs."""
    old, new = before.scoped, after.scoped
    changed: dict[str, tuple[Part, ...]] = {}
    digests: dict[str, tuple[str, str]] = {}
    for code in sorted(old.keys() & new.keys()):
        a = Meaning(before, old[code], own_params(before, old[code]))
        b = Meaning(after, new[code], own_params(after, new[code]))
        marks = (rule_digest(a.rules, a.rule, a.params), rule_digest(b.rules, b.rule, b.params))
        if marks[0] != marks[1]:
            changed[code], digests[code] = tuple(differences(a, b)), marks
    named = {part.name for parts in changed.values() for part in parts if part.kind == "param"}
    values = {
        name: [rules.params.get(name) for rules in (before, after)]
        for name in sorted({**before.params, **after.params}.keys() - named)
    }
    said = {
        name: [None if value is None else syntax_words.value(value) for value in both]
        for name, both in values.items()
        if both[0] != both[1]
    }
    return Comparison(
        {code: new[code].title for code in sorted(new.keys() - old.keys())},
        {code: old[code].title for code in sorted(old.keys() - new.keys())},
        changed,
        tuple(sorted(old.keys() & new.keys() - changed.keys())),
        digests,
        tuple(Part("param", name, *both) for name, both in said.items()),
        tuple(_goals(before, after)),
    )


def _goals(before: ast.RuleSet, after: ast.RuleSet) -> Iterator[str]:
    """Goals that come, go, or reach something else."""
    old, new = (
        {name: (goal, reached(rules, goal, rules.params)) for name, goal in rules.goals.items()}
        for rules in (before, after)
    )
    for name in sorted(old.keys() | new.keys()):
        if old.get(name) != new.get(name):
            change = "changed" if name in old and name in new else "added"
            yield f"goal {name} {change if name in new else 'left out'}"
