"""Results of a rule's examples, and the mutated rules that they do not detect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from safestage_eval._text.line_width import LINE_WIDTH, folded
from safestage_eval._text.plural import count
from safestage_eval.units import format_quantity, in_unit, unit_of

from .render_json import render_json
from .render_junit import Case, render_junit
from .render_text import text_lines
from .table import Table

if TYPE_CHECKING:
    from safestage_eval.whatif.examples import Checked, Suite
    from safestage_eval.whatif.mutants import Hunted


def render(
    suites: Mapping[str, Suite], hunted: Mapping[str, Sequence[Hunted]] | None, form: str
) -> str:
    """Results in one of the formats table, json, junit.

    Args:
        suites: rule file as asked for → its examples.
        hunted: rule file → its mutants; None if none were made.
        form: the format.
    """
    return {"table": _table, "json": _json, "junit": _junit}[form](suites, hunted)


def _table(suites: Mapping[str, Suite], hunted: Mapping[str, Sequence[Hunted]] | None) -> str:
    rows: list[list[str]] = []
    for suite in suites.values():
        rows += [
            [
                "ok" if c.right else "NO",
                c.rule,
                c.name,
                c.expected,
                c.got.replace("_", " "),
                _margin(c),
                c.why.partition("\n")[0],
            ]
            for c in suite.checked
        ]
    head = ("", "rule", "example", "expected", "got", "margin", "why")
    width = LINE_WIDTH.get()
    table = Table("", head, rows, len(head), texts=1)
    lines = text_lines(table, width) if rows else []
    for suite in suites.values():
        lines += [
            f"NO  {_lacks(code, *counts, suite.least)}" for code, counts in suite.lacking.items()
        ]
    checked = [c for suite in suites.values() for c in suite.checked]
    right = sum(c.right for c in checked)
    rules = len({c.rule for c in checked})
    lines.append(
        f"{right} of {count(len(checked), 'example')} of {count(rules, 'rule')} as expected"
    )
    if hunted is not None:
        every = [m for mutants in hunted.values() for m in mutants]
        alive = [m for m in every if m.killer is None and m.tested]
        idle = [m for m in every if not m.tested]
        if alive:
            lines += [
                "",
                "Mutants that no example detects (add an example, or drop that part of the rule):",
            ]
            rows = [[f"  {m.where}", m.kind, m.what] for m in alive]
            lines += text_lines(Table("", (), rows, 3, texts=1), width)
        if idle:
            where = ", ".join(dict.fromkeys(m.where for m in idle))
            lines += [
                "",
                f"{count(len(idle), 'mutant')} of {where} not tested: no example comes out as expected.",
            ]
        lines.append(
            f"{len(every) - len(alive) - len(idle)} of {count(len(every) - len(idle), 'mutant')} "
            "detected"
        )
    return folded("\n".join(lines), width) + "\n"


def _json(suites: Mapping[str, Suite], hunted: Mapping[str, Sequence[Hunted]] | None) -> str:
    document: dict[str, Any] = {
        "examples": [
            {"rules": name, **_facts(c)} for name, suite in suites.items() for c in suite.checked
        ],
        "lacking": [
            {"rules": name, "rule": code, "violating": counts[0], "passing": counts[1]}
            for name, suite in suites.items()
            for code, counts in suite.lacking.items()
        ],
    }
    if hunted is not None:
        document["mutants"] = [
            {
                "rules": name,
                "rule": m.where,
                "kind": m.kind,
                "what": m.what,
                "killer": m.killer,
                "tested": m.tested,
            }
            for name, mutants in hunted.items()
            for m in mutants
        ]
    return render_json(document)


def _junit(suites: Mapping[str, Suite], hunted: Mapping[str, Sequence[Hunted]] | None) -> str:
    return render_junit(
        "safestage rules test",
        {
            name: [
                *(_case(f"{name}.{c.rule}", c) for c in suite.checked),
                *(
                    Case(
                        f"{name}.{code}",
                        "enough examples",
                        "failure",
                        _lacks(code, *counts, suite.least),
                    )
                    for code, counts in suite.lacking.items()
                ),
                *(_mutant(f"{name}.{m.where}.mutants", m) for m in (hunted or {}).get(name, ())),
            ]
            for name, suite in suites.items()
        },
    )


def _case(classname: str, c: Checked) -> Case:
    if c.verdict is None:
        return Case(classname, c.name, "error", c.problem)
    if not c.right:
        return Case(classname, c.name, "failure", f"expected {c.expected}, got {c.got}: {c.why}")
    return Case(classname, c.name)


def _mutant(classname: str, m: Hunted) -> Case:
    if not m.tested:
        return Case(classname, m.what, "skipped", "no example comes out as expected")
    if m.killer is None:
        return Case(classname, m.what, "failure", "no example detects this mutant")
    return Case(classname, m.what)


def _facts(c: Checked) -> dict[str, Any]:
    v = c.verdict
    dimension = v.dimension if v is not None else None
    margin = v.margin if v is not None else None
    return {
        "rule": c.rule,
        "example": c.name,
        "expected": c.expected,
        "got": c.got,
        "right": c.right,
        "margin": margin if margin is None or not dimension else in_unit(margin, dimension),
        "unit": unit_of(dimension) if dimension else None,
        "why": c.why,
    }


def _margin(c: Checked) -> str:
    if c.verdict is None or c.verdict.margin is None:
        return ""
    return format_quantity(c.verdict.margin, c.verdict.dimension or "")


def _lacks(code: str, violating: int, passing: int, least: int) -> str:
    return (
        f"{code} names {violating} violating and {passing} passing examples under [rule.examples], "
        f"{least} of each are required (--least)"
    )
