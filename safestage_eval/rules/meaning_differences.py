"""Differences between two meanings of one rule, and rules with some of them applied."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from . import syntax as ast
from . import syntax_words
from .clauses import CLAUSES, ClauseKind
from .uses import uses_of

Kind = (
    Literal[
        "param", "material", "state", "phase", "signal", "baseline",
        "given", "during", "at", "until", "for", "roles", "cost",
    ]
    | ClauseKind
)  # fmt: skip

_LISTED = [kind for kind, clause in CLAUSES.items() if clause.value != "alternative"]
"""Obligations whose entries are parts of their own."""

_FIELDS: dict[Kind, str] = {
    **{kind: kind for kind in CLAUSES if kind not in _LISTED},
    "given": "given", "during": "during", "at": "at", "until": "until",
    "for": "for_", "roles": "roles",
}  # fmt: skip

_WORDS: dict[str, str] = {
    **{kind: clause.heading for kind, clause in CLAUSES.items()},
    "given": "only if", "during": "judged during", "at": "judged at", "until": "until",
    "for": "for", "roles": "roles",
}  # fmt: skip


_ORDER: tuple[Kind, ...] = (
    "param", "material", "state", "phase", "signal", "baseline", "cost", *_LISTED, *_FIELDS
)  # fmt: skip
"""Of parts in lists."""


@dataclass(frozen=True)
class Part:
    """One thing that differs between two meanings of a rule.

    Attributes:
        kind, name: ``param``, ``min_clearance``; ``require``, ``tilt(target)``; ….
        before, after: in words; None where it is missing.
    """

    kind: Kind
    name: str
    before: str | None = None
    after: str | None = None

    @property
    def label(self) -> str:
        """The name of the part in reports: a parameter by its name alone."""
        if self.kind == "param":
            return self.name
        said = _WORDS.get(self.kind, self.kind)
        return f"{said} {self.name}".strip()

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
    old, new = (_parts(side, before, after) for side in (before, after))
    keys = sorted(_union(old, new), key=lambda key: _ORDER.index(key[0]))
    parts = []
    for key in keys:
        a, b = old.get(key), new.get(key)
        if a != b:
            said = [_said(key, part, side) for part, side in ((a, before), (b, after))]
            if key[0] == "cost" and said[0] == said[1]:
                said = ["as it was", "as it is"]
            parts.append(Part(*key, *said))
    return parts


def mixed(before: Meaning, after: Meaning, chosen: Collection[Part]) -> Meaning:
    """The rule as before, but with some parts as after."""
    keys = {(part.kind, part.name) for part in chosen}

    def pick(kind: Kind, old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
        return {**new, **old, **{k: v for k, v in new.items() if (kind, k) in keys}}

    a, b = before.rules, after.rules
    materials: dict[str, dict[str, ast.Quantity]] = {}
    for name in _union(a.materials, b.materials):
        old, new = a.materials.get(name, {}), b.materials.get(name, {})
        sides = {c: new if ("material", f"{name}.{c}") in keys else old for c in _union(old, new)}
        materials[name] = {column: row[column] for column, row in sides.items() if column in row}
    for column, value in b.materials.get("default", {}).items():
        materials["default"].setdefault(column, value)
    rule = _mixed_rule(before.rule, after.rule, keys)
    signals = pick("signal", {**a.signals, **a.derived}, {**b.signals, **b.derived})
    rules = replace(
        a,
        materials=materials,
        signals={name: one for name, one in signals.items() if isinstance(one, ast.SignalDef)},
        states=pick("state", a.states, b.states),
        phases=pick("phase", a.phases, b.phases),
        baseline=b.baseline if ("baseline", "") in keys else a.baseline,
        derived={name: one for name, one in signals.items() if isinstance(one, ast.DerivedDef)},
    ).with_scoped(rule)
    return Meaning(rules, rule, pick("param", before.params, after.params))


def _mixed_rule(old: ast.Scoped, new: ast.Scoped, keys: Collection[tuple[str, str]]) -> ast.Scoped:
    if isinstance(old, ast.Cost) or isinstance(new, ast.Cost):
        return new if ("cost", "") in keys else old
    changes: dict[str, Any] = {
        field: getattr(new, field) for kind, field in _FIELDS.items() if (kind, "") in keys
    }
    for kind in _LISTED:
        merged, others = _entries(old, kind), _entries(new, kind)
        for name in [name for name in _union(merged, others) if (kind, name) in keys]:
            merged.pop(name, None)
            merged |= {name: others[name]} if name in others else {}
        items: Any = tuple(merged.values())
        if CLAUSES[kind].value == "condition":
            items = ast.Condition(items) if items else None
        changes[kind] = items
    return replace(old, **changes)


def _parts(side: Meaning, *both: Meaning) -> dict[tuple[Kind, str], Any]:
    """All that a rule's meaning is made of: the definitions that either of both reaches, and what is its own."""
    rules, rule = side.rules, side.rule
    uses = [uses_of(one.rules, one.rule, one.params) for one in both]
    parts: dict[tuple[Kind, str], Any] = {
        ("param", name): side.params.get(name) for one in uses for name in one.params
    }
    for material in [name for one in both for name in one.rules.materials]:
        for column in [column for one in uses for column in one.columns]:
            cell = rules.materials.get(material, {}).get(column)
            parts["material", f"{material}.{column}"] = cell
    called = {name for one in uses for name in (*one.states, *one.phases)}
    parts |= {("state", name): node for name, node in rules.states.items() if name in called}
    parts |= {("phase", name): node for name, node in rules.phases.items() if name in called}
    parts |= {("signal", name): node for name, node in {**rules.signals, **rules.derived}.items()}
    parts["baseline", ""] = rules.baseline
    if any(isinstance(one.rule, ast.Cost) for one in both):
        parts["cost", ""] = replace(rule, title="", set=())
        return parts
    for kind in _LISTED:
        parts |= {(kind, name): item for name, item in _entries(rule, kind).items()}
    return parts | {(kind, ""): getattr(rule, field) for kind, field in _FIELDS.items()}


def _entries(rule: ast.Scoped, kind: ClauseKind) -> dict[str, Any]:
    """The entries of an obligation by what they are about; a second one of the same name is numbered."""
    by_name: dict[str, Any] = {}
    for item in CLAUSES[kind].entries(getattr(rule, kind)):
        name = unique = _name(item)
        count = 2
        while unique in by_name:
            unique, count = f"{name} ({count})", count + 1
        by_name[unique] = item
    return by_name


def _name(item: Any) -> str:
    """The name of an entry: its call without the limit, so that a limit can change."""
    if isinstance(item, ast.Condition) and len(item.atoms) == 1:
        item = item.atoms[0]
    if isinstance(item, ast.SignalAtom):
        since = f" since {syntax_words.event(item.since)}" if item.since is not None else ""
        return f"{item.call}{since}"
    if isinstance(item, ast.StateAtom | ast.CountAtom):
        return str(item.call)
    return _in_words(item, {})


def _said(key: tuple[Kind, str], item: Any, side: Meaning) -> str | None:
    """A part in words, an entry without the name that it is listed under; None where it is missing."""
    if item is None:
        return None
    if key[0] in _LISTED:
        said = _in_words(item, side.params)
        return said.removeprefix(key[1]).strip() or said
    return _in_words(item, side.params)


def _in_words(item: Any, params: ast.Params) -> str:
    match item:
        case ast.Quantity() | ast.Duration():
            return syntax_words.value(item)
        case ast.Parameter():
            return syntax_words.duration(item, params)
        case ast.Condition() | ast.Event():
            return syntax_words.alternative(item, params)
        case ast.SignalAtom() | ast.StateAtom() | ast.CountAtom() | ast.AnyOf():
            return syntax_words.atom(item, params)
        case ast.StateDef():
            return syntax_words.state(item, params)
        case ast.PhaseDef():
            return syntax_words.phase(item, params)
        case ast.DerivedDef():
            return syntax_words.derived(item, params)
        case ast.SignalDef():
            return item.base
        case ast.Cost():
            return "; ".join(syntax_words.charge(one, params) for one in item.charge)
        case ast.Rule():
            return "a rule"
        case tuple():  # roles
            return "; ".join(f"{name}: {syntax_words.role(spec)}" for name, spec in item)
    return syntax_words.span(item, params)


def value_text(value: ast.Setting | None) -> str | None:
    """A value in words; None stays."""
    return None if value is None else syntax_words.value(value)


def _union(old: Collection[Any], new: Collection[Any]) -> list[Any]:
    """The old names in their order, then the new ones."""
    return list(dict.fromkeys([*old, *new]))
