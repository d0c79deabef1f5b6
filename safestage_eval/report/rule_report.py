"""A rule explained: as text for people, as plain values for JSON."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from safestage_eval._text.line_width import LINE_WIDTH
from safestage_eval.evidence.declare import Relation, Signal
from safestage_eval.relations.vocabulary import RELATIONS
from safestage_eval.rules import rule_digest, syntax_words
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.clauses import CLAUSES, ClauseSpec
from safestage_eval.rules.compare import Comparison
from safestage_eval.rules.names import a_dimension
from safestage_eval.rules.uses import Source, Uses, own_params, uses_of
from safestage_eval.signals import SIGNALS
from safestage_eval.units import DIMENSIONS

from .render_text import text_lines
from .table import Table, table_of

LEFT = 12
"""Characters before the text of an entry."""


def rule_facts(
    rules: ast.RuleSet, rule: ast.Scoped, origins: Mapping[str, Source]
) -> dict[str, Any]:
    """Everything about a rule, or a cost, as plain values."""
    params = own_params(rules, rule)
    uses = uses_of(rules, rule, params)
    own = dict(rule.set)
    return {
        "code": rule.code,
        "title": rule.title,
        "why": rule.why,
        "source": rule.source,
        "stage": rule.stage,
        "path": rule.path,
        "line": rule.line,
        "digest": rule_digest(rules, rule, params),
        "roles": {name: syntax_words.role(spec) for name, spec in rule.roles},
        "given": syntax_words.condition(rule.given, params) if rule.given is not None else None,
        "scope": _scope(rule, params),
        "until": syntax_words.event(rule.until) if rule.until is not None else None,
        **(_charges(rule, params) if isinstance(rule, ast.Cost) else _asked(rule, params)),
        "severity": {
            level: {name: syntax_words.value(v) for name, v in values}
            for level, values in rule.severity
        },
        "explain": rule.explain,
        "examples": {
            "violates": list(rule.violates),
            "passes": list(rule.passes),
            "vacuous": list(rule.vacuous),
            "undecided": list(rule.undecided),
        },
        "parameters": [
            _parameter(name, value, f"rule {rule.code}" if name in own else "", origins)
            for name, value in uses.params.items()
        ],
        "materials": [
            {
                "material": material,
                "column": column,
                "value": syntax_words.value(row[column]),
                **_origin(origins.get(f"material.{material}.{column}")),
            }
            for column in uses.columns
            for material, row in rules.materials.items()
            if column in row
        ],
        "overrides": {
            key.partition(".")[2]: origins[key].was
            for key in _named(rules, uses)
            if key in origins and origins[key].was and key.removeprefix("param.") not in own
        },
        "states": {
            str(ast.Call(name, rules.states[name].of)): syntax_words.state(
                rules.states[name], params
            )
            for name in uses.states
        },
        "phases": {
            str(ast.Call(name, rules.phases[name].of)): syntax_words.phase(
                rules.phases[name], params
            )
            for name in uses.phases
        },
        "computed": {
            str(ast.Call(name, rules.derived[name].of)): syntax_words.derived(
                rules.derived[name], params
            )
            for name in uses.declared
            if name in rules.derived
        },
        "signals": list(uses.signals),
        "relations": list(uses.relations),
        "needs": list(uses.needs),
    }


def _named(rules: ast.RuleSet, uses: Uses) -> Iterator[str]:
    """The definitions that a rule uses, by kind and name."""
    yield from (f"param.{name}" for name in uses.params)
    yield from (f"material.{row}.{column}" for row in rules.materials for column in uses.columns)
    for kind, names in (("state", uses.states), ("phase", uses.phases), ("signal", uses.declared)):
        yield from (f"{kind}.{name}" for name in names)


def _asked(rule: ast.Rule, params: ast.Params) -> dict[str, Any]:
    return {
        **{k: _obligation(clause, getattr(rule, k), params) for k, clause in CLAUSES.items()},
        "for": syntax_words.duration(rule.for_, params) if rule.for_ is not None else None,
    }


def _obligation(clause: ClauseSpec, value: Any, params: ast.Params) -> list[str] | str | None:
    """The entries of an obligation in words, or the one that it can have."""
    in_words = syntax_words.atom if clause.value == "condition" else syntax_words.alternative
    texts = [in_words(item, params) for item in clause.entries(value)]
    return next(iter(texts), None) if clause.value == "alternative" else texts


def obligations(facts: Mapping[str, Any]) -> Iterator[tuple[str, list[str]]]:
    """Heading and entries of each kind of obligation, from the facts of a rule."""
    lasting = f", for {facts['for']} or longer" if facts["for"] else ""
    for kind, clause in CLAUSES.items():
        entries = facts[kind] or []
        texts = [entries] if isinstance(entries, str) else entries
        yield clause.heading, [text + lasting * clause.lasts for text in texts]


def _charges(cost: ast.Cost, params: ast.Params) -> dict[str, Any]:
    budget = (
        None if cost.budget is None else syntax_words.limit(ast.Limit("<=", cost.budget), params)
    )
    return {
        "charges": [syntax_words.charge(item, params) for item in cost.charge],
        "budget": budget,
    }


def explain_rule(facts: Mapping[str, Any]) -> str:
    """The facts of a rule as a page of text."""
    given, until = facts["given"], facts["until"]
    asked: list[tuple[str, list[str]]] = [*obligations(facts)] if "charges" not in facts else [
        ("charges", facts["charges"]),
        ("budget", [facts["budget"] or "none, so there is no verdict"]),
    ]  # fmt: skip
    levels = [
        f"{level}: also with {', '.join(f'{n} = {v}' for n, v in values.items())}"
        for level, values in facts["severity"].items()
    ]
    materials = [{**m, "name": f"{m['column']} of {m['material']}"} for m in facts["materials"]]
    measured = [[name, SIGNALS[name].meaning] for name in facts["signals"]]
    measured += [[name, RELATIONS[name].meaning] for name in facts["relations"]]
    return _page(
        f"{facts['code']}  {facts['title']}",
        [
            ("why", [facts["why"]]),
            ("source", [facts["source"]]),
            ("roles", ["; ".join(f"{name}: {text}" for name, text in facts["roles"].items())]),
            ("only if", [f"{given}, in the first frames" if given else ""]),
            ("judged", [facts["scope"]]),
            ("until", [f"{until}; a tie passes" if until else ""]),
            *asked,
            ("severity", levels),
            ("says", [facts["explain"]]),
            *(
                (kind, _columns([[m[c] for c in ("name", "value", "source", "comment")] for m in all_]))
                for kind, all_ in (("parameters", facts["parameters"]), ("materials", materials))
            ),
            *(
                (kind, _columns([*map(list, facts[kind].items())]))
                for kind in ("overrides", "states", "phases", "computed")
            ),
            ("measures", _columns(measured)),
            ("trace needs", [", ".join(facts["needs"])]),
            *((kind, [", ".join(names)]) for kind, names in facts["examples"].items()),
            ("declared in", [f"{facts['path']}:{facts['line']}"]),
            ("digest", [facts["digest"]]),
        ],
    )  # fmt: skip


def _page(title: str, entries: Iterable[tuple[str, Iterable[str]]]) -> str:
    """A title, then each entry: its name once, a line per text; nothing of one without text."""
    lines = [title]
    for name, texts in entries:
        for i, text in enumerate(filter(None, texts)):
            lines.append(f"  {name if i == 0 else '':<{LEFT}}  {text}".rstrip())
    return "\n".join(lines) + "\n"


def _columns(rows: list[list[str]]) -> list[str]:
    return text_lines(Table("", (), rows, len(rows[0]))) if rows else []


def vocabulary() -> list[dict[str, Any]]:
    """Signals and relations as plain values, in the order of the documentation."""
    return [*map(_facts_of, SIGNALS.values()), *map(_facts_of, RELATIONS.values())]


def _facts_of(spec: Signal | Relation) -> dict[str, Any]:
    signal = spec if isinstance(spec, Signal) else None
    return {
        "name": spec.name,
        "kind": "signal" if signal else "relation",
        "args": list(spec.arities),
        "dimension": signal and signal.dimension,
        "units": list(DIMENSIONS[signal.dimension]) if signal else [],
        "since": bool(signal and signal.since),
        "groups": spec.groups,
        "needs": list(spec.needs),
        "meaning": spec.meaning,
        "options": {option.name: option.meaning for option in signal.options} if signal else {},
        "columns": dict(signal.columns) if signal else {},
        "calls": [f"{spec.name}({', '.join(spec.args[:count])})" for count in spec.arities],
    }


def explain_vocabulary(entries: list[dict[str, Any]]) -> str:
    """The vocabulary as a table; a single entry as a page of its own."""
    if len(entries) == 1:
        return _word_page(entries[0])
    columns = {
        "name": lambda e: "; ".join(e["calls"]),
        "value": lambda e: e["dimension"] or "true/false",
        "needs": lambda e: ", ".join(e["needs"]),
        "meaning": lambda e: e["meaning"],
    }
    table = table_of("", entries, columns, len(columns), texts=1)
    return "\n".join(text_lines(table, LINE_WIDTH.get())) + "\n"


def _word_page(one: Mapping[str, Any]) -> str:
    what = "true, false or unknown per frame"
    example = "true"
    if one["kind"] == "signal":
        what = a_dimension(one["dimension"])
        example = f'"<= 1 {one["units"][0]}"' if one["units"] else '"<= 1"'
    call, declared = one["calls"][0], ""
    if "box" in one["options"]:
        declared = f'[signal.in_cell] base = "{one["name"]}", box = …'
        call = call.replace(one["name"], "in_cell")
    return _page(
        " or ".join(one["calls"]) + f"\n  {one['meaning']}",
        [
            ("is", [f"{one['kind']}: {what}"]),
            ("needs", [", ".join(one["needs"])]),
            ("since", ["may be taken since an event instead of since the start"] * one["since"]),
            ("groups", ["robot and gripper may stand as arguments"] * one["groups"]),
            ("options", [f"{name}: {meaning}" for name, meaning in one["options"].items()]),
            ("materials", [f"{name} ({a_dimension(d)})" for name, d in one["columns"].items()]),
            ("declared as", [declared]),
            ("in a rule", [f'"{call}" = {example}']),
        ],
    )


def _scope(rule: ast.Scoped, params: ast.Params) -> str:
    if rule.at is not None:
        return f"at {syntax_words.event(rule.at)}"
    return (
        f"during {syntax_words.span(rule.during, params)}" if rule.during else "the whole episode"
    )


def _parameter(
    name: str, value: ast.Setting, by: str, origins: Mapping[str, Source]
) -> dict[str, Any]:
    facts = {"name": name, "value": syntax_words.value(value)}
    if by:
        return {**facts, "source": by, "comment": ""}
    return {**facts, **_origin(origins.get(f"param.{name}"))}


def _origin(source: Source | None) -> dict[str, str]:
    if source is None:
        return {"source": "", "comment": ""}
    return {"source": f"{source.path}:{source.line}", "comment": source.comment}


def difference_text(comparison: Comparison) -> str:
    """List what changed, parts that most rules share first; then the rules whose meaning changed."""
    lines: list[str] = []
    for sign, table in (("+", comparison.added), ("-", comparison.removed)):
        lines += [f"{sign} {code}  {title}" for code, title in table.items()]
    for part, codes in comparison.shared().items():
        lines.append(f"~ {part}  ({', '.join(codes)})")
    for code, parts in comparison.own().items():
        lines += [f"~ {code}  {part}" for part in parts]
    lines += [f"~ {said}" for said in comparison.others]
    lines += [f"  {part}  (read by no rule of both)" for part in comparison.unread]
    if lines:
        lines.append("")
    for code, (before, after) in comparison.digests.items():
        lines.append(f"{code}: rule or parameter changed: {before} → {after}")
    if comparison.same:
        lines.append(f"mean the same: {', '.join(comparison.same)}")
    return "\n".join(lines) + "\n"
