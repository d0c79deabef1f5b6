"""Differences between two meanings of one rule, and rules with some of them applied."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields, replace
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
    values = [
        Part("param", name, value_text(before.params.get(name)), value_text(after.params.get(name)))
        for name in _union(_uses(before).params, _uses(after).params)
        if before.params.get(name) != after.params.get(name)
    ]
    parts = []
    for material, column in _cells(before, after):
        old, new = (_cell(side, material, column) for side in (before, after))
        if old != new:
            parts.append(Part("material", f"{material}.{column}", value_text(old), value_text(new)))
    for kind, old_table, new_table, said in _definitions(before, after):
        for name in _union(old_table, new_table):
            old_def, new_def = old_table.get(name), new_table.get(name)
            if old_def != new_def:
                parts.append(Part(kind, name, said(old_def, before), said(new_def, after)))
    if before.rules.baseline != after.rules.baseline:
        spans = (syntax_words.span(side.rules.baseline, side.params) for side in (before, after))
        parts.append(Part("baseline", "", *spans))
    return values + parts + _of_rule(before, after)


def mixed(before: Meaning, after: Meaning, chosen: Collection[Part]) -> Meaning:
    """The rule as before, but with some parts as after."""
    keys = {(part.kind, part.name) for part in chosen}

    def pick(kind: Kind, old: Mapping[str, Any], new: Mapping[str, Any]) -> dict[str, Any]:
        return {**new, **old, **{k: v for k, v in new.items() if (kind, k) in keys}}

    a, b = before.rules, after.rules
    materials: dict[str, dict[str, ast.Quantity]] = {}
    for name in _union(a.materials, b.materials):
        old, new = a.materials.get(name, {}), b.materials.get(name, {})
        row = dict(old)
        for column in _union(old, new):
            if ("material", f"{name}.{column}") in keys:
                row.pop(column, None)
                row.update({column: new[column]} if column in new else {})
        materials[name] = row
    for column, value in b.materials.get("default", {}).items():
        materials["default"].setdefault(column, value)
    rule = _mixed_rule(before.rule, after.rule, keys)
    rules = replace(
        a,
        materials=materials,
        signals=_still(pick("signal", _signals(a), _signals(b)), ast.SignalDef),
        derived=_still(pick("signal", _signals(a), _signals(b)), ast.DerivedDef),
        states=pick("state", a.states, b.states),
        phases=pick("phase", a.phases, b.phases),
        baseline=b.baseline if ("baseline", "") in keys else a.baseline,
        rules={**a.rules, rule.code: rule} if isinstance(rule, ast.Rule) else a.rules,
        costs={**a.costs, rule.code: rule} if isinstance(rule, ast.Cost) else a.costs,
    )
    return Meaning(rules, rule, pick("param", before.params, after.params))


def _mixed_rule(old: ast.Scoped, new: ast.Scoped, keys: Collection[tuple[str, str]]) -> ast.Scoped:
    if isinstance(old, ast.Cost) or isinstance(new, ast.Cost):
        return new if ("cost", "") in keys else old
    changes: dict[str, Any] = {
        field: getattr(new, field) for kind, field in _FIELDS.items() if (kind, "") in keys
    }
    for kind in _LISTED:
        merged: Any = _merged(kind, _entries(old, kind), _entries(new, kind), keys)
        if CLAUSES[kind].value == "condition":
            merged = ast.Condition(merged) if merged else None
        changes[kind] = merged
    return replace(old, **changes)


def _merged(
    kind: str, old: Mapping[str, Any], new: Mapping[str, Any], keys: Collection[tuple[str, str]]
) -> tuple[Any, ...]:
    merged = dict(old)
    for name in _union(old, new):
        if (kind, name) in keys:
            merged.pop(name, None)
            merged.update({name: new[name]} if name in new else {})
    return tuple(merged.values())


def _of_rule(before: Meaning, after: Meaning) -> list[Part]:
    old, new = before.rule, after.rule
    if isinstance(old, ast.Cost) or isinstance(new, ast.Cost):
        names = [f.name for f in fields(old) if f.compare and f.name not in ("title", "set")]
        if type(old) is type(new) and all(getattr(old, n) == getattr(new, n) for n in names):
            return []
        said = [_charged(side) for side in (before, after)]
        return [Part("cost", "", *(said if said[0] != said[1] else ("as it was", "as it is")))]
    parts = []
    for kind in _LISTED:
        before_items, after_items = _entries(old, kind), _entries(new, kind)
        for name in _union(before_items, after_items):
            a, b = before_items.get(name), after_items.get(name)
            if a != b:
                parts.append(
                    Part(
                        kind,
                        name,
                        None if a is None else _limits(name, a, before.params),
                        None if b is None else _limits(name, b, after.params),
                    )
                )
    for field, attribute in _FIELDS.items():
        a, b = getattr(old, attribute), getattr(new, attribute)
        if a != b:
            parts.append(Part(field, "", _said(a, before.params), _said(b, after.params)))
    return parts


def _charged(side: Meaning) -> str:
    charges = side.rule.charge if isinstance(side.rule, ast.Cost) else ()
    return "; ".join(syntax_words.charge(item, side.params) for item in charges) or "a rule"


def _entries(rule: ast.Rule, kind: ClauseKind) -> dict[str, ast.Atom | ast.Alternative]:
    """The entries of an obligation by what they are about."""
    items = CLAUSES[kind].entries(getattr(rule, kind))
    return _named({}, [(_name(item), item) for item in items])


def _named(by_name: dict[str, Any], items: list[tuple[str, Any]]) -> dict[str, Any]:
    """By name; a second one of the same name is numbered."""
    for name, item in items:
        unique, count = name, 2
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
    if isinstance(item, ast.Event):
        return syntax_words.event(item)
    return (
        syntax_words.atom(item, {})
        if isinstance(item, ast.AnyOf)
        else syntax_words.condition(item, {})
    )


def _limits(name: str, item: Any, params: ast.Params) -> str:
    """An obligation in words, without the name that it is listed under."""
    said = _said(item, params) or ""
    return said.removeprefix(name).strip() or said


def _said(item: Any, params: ast.Params) -> str | None:
    if item is None:
        return None
    if isinstance(item, ast.Condition):
        return syntax_words.condition(item, params)
    if isinstance(item, ast.Event):
        return syntax_words.event(item)
    if isinstance(item, ast.Duration | ast.Parameter):
        return syntax_words.duration(item, params)
    if isinstance(item, ast.Atom):
        return syntax_words.atom(item, params)
    if isinstance(item, tuple):  # roles
        return "; ".join(f"{name}: {syntax_words.role(spec)}" for name, spec in item)
    return syntax_words.span(item, params)


def _definitions(before: Meaning, after: Meaning) -> list[tuple[Kind, Any, Any, Any]]:
    """States, phases and signals that either meaning reaches."""
    used = [_uses(side) for side in (before, after)]
    called = {name for side in used for name in (*side.states, *side.phases)}
    a, b = before.rules, after.rules

    def reached(table: Mapping[str, Any]) -> dict[str, Any]:
        return {name: item for name, item in table.items() if name in called}

    return [
        ("state", reached(a.states), reached(b.states), _state),
        ("phase", reached(a.phases), reached(b.phases), _phase),
        ("signal", _signals(a), _signals(b), _signal),
    ]


def _signals(rules: ast.RuleSet) -> dict[str, Any]:
    """Variants and derived signals by name."""
    return {**rules.signals, **rules.derived}


def _still(signals: Mapping[str, Any], kind: type) -> dict[str, Any]:
    return {name: one for name, one in signals.items() if isinstance(one, kind)}


def _signal(item: ast.SignalDef | ast.DerivedDef | None, side: Meaning) -> str | None:
    if isinstance(item, ast.DerivedDef):
        return syntax_words.derived(item, side.params)
    return None if item is None else item.base


def _state(item: ast.StateDef | None, side: Meaning) -> str | None:
    return None if item is None else syntax_words.state(item, side.params)


def _phase(item: ast.PhaseDef | None, side: Meaning) -> str | None:
    return None if item is None else syntax_words.phase(item, side.params)


def _uses(side: Meaning) -> Any:
    return uses_of(side.rules, side.rule, side.params)


def _cells(before: Meaning, after: Meaning) -> list[tuple[str, str]]:
    columns = _union(_uses(before).columns, _uses(after).columns)
    materials = _union(before.rules.materials, after.rules.materials)
    return [(material, column) for material in materials for column in columns]


def _cell(side: Meaning, material: str, column: str) -> ast.Quantity | None:
    return side.rules.materials.get(material, {}).get(column)


def value_text(value: ast.Setting | None) -> str | None:
    """A value in words; None stays."""
    return None if value is None else syntax_words.value(value)


def _union(old: Collection[str], new: Collection[str]) -> list[str]:
    """The old names in their order, then the new ones."""
    return list(dict.fromkeys([*old, *new]))
