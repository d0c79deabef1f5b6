"""Results of a rule's examples, and the mutated rules that they do not detect."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from safestage_eval._text.plural import count
from safestage_eval.units import format_quantity, in_unit, unit_of

from .document import Document
from .for_build_servers import Case, render_junit
from .table import Table, table_of

if TYPE_CHECKING:
    from safestage_eval.whatif.examples import Checked, Suite
    from safestage_eval.whatif.mutants import Hunted

    Hunts = Mapping[str, Sequence[Hunted]]

UNNOTICED = "Mutants that no example detects (add an example, or drop that part of the rule):"


def render(suites: Mapping[str, Suite], hunted: Hunts | None, form: str) -> str:
    """Results in one of the formats table, json, junit.

    Args:
        suites: rule file as asked for → its examples.
        hunted: rule file → its mutants; None if none were made.
        form: the format.
    """
    if form == "junit":
        return _junit(suites, hunted or {})
    return _document(suites, hunted).render(form)


def _document(suites: Mapping[str, Suite], hunted: Hunts | None) -> Document:
    checked = [c for suite in suites.values() for c in suite.checked]
    tables = []
    if checked:
        tables.append(
            table_of(
                "",
                checked,
                {
                    "": lambda c: "ok" if c.right else "NO",
                    "rule": lambda c: c.rule,
                    "example": lambda c: c.name,
                    "expected": lambda c: c.expected,
                    "got": lambda c: c.got.replace("_", " "),
                    "margin": _margin,
                    "why": lambda c: c.why.partition("\n")[0],
                },
                7,
                texts=1,
            )
        )
    right, rules = sum(c.right for c in checked), len({c.rule for c in checked})
    notes = [f"NO  {_lacks(*lacking)}" for suite in suites.values() for lacking in _lacking(suite)]
    notes.append(
        f"{right} of {count(len(checked), 'example')} of {count(rules, 'rule')} as expected"
    )
    every = [m for mutants in (hunted or {}).values() for m in mutants]
    tested = [m for m in every if m.tested]
    if alive := [m for m in tested if m.killer is None]:
        tables.append(Table(UNNOTICED, (), [[f"  {m.where}", m.kind, m.what] for m in alive], 3, 1))
    if len(tested) < len(every):
        where = ", ".join(dict.fromkeys(m.where for m in every if not m.tested))
        idle = count(len(every) - len(tested), "mutant")
        notes.append(f"{idle} of {where} not tested: no example comes out as expected.")
    if hunted is not None:
        notes.append(f"{len(tested) - len(alive)} of {count(len(tested), 'mutant')} detected")
    return Document(tables, notes, facts=lambda: _facts(suites, hunted))


def _facts(suites: Mapping[str, Suite], hunted: Hunts | None) -> dict[str, Any]:
    document: dict[str, Any] = {
        "examples": [
            {"rules": name, **_of_example(c)} for name, suite in suites.items() for c in suite.checked
        ],
        "lacking": [
            {"rules": name, "rule": code, "violating": violating, "passing": passing}
            for name, suite in suites.items()
            for code, violating, passing, _ in _lacking(suite)
        ],
    }  # fmt: skip
    if hunted is not None:
        names = ("kind", "what", "killer", "tested")
        document["mutants"] = [
            {"rules": name, "rule": m.where, **{field: getattr(m, field) for field in names}}
            for name, mutants in hunted.items()
            for m in mutants
        ]
    return document


def _of_example(c: Checked) -> dict[str, Any]:
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


def _lacking(suite: Suite) -> list[tuple[str, int, int, int]]:
    """Rules with too few examples: how many violate, how many pass, and how many should."""
    return [(code, *counts, suite.least) for code, counts in suite.lacking.items()]


def _lacks(code: str, violating: int, passing: int, least: int) -> str:
    return (
        f"{code} names {violating} violating and {passing} passing examples under [rule.examples], "
        f"{least} of each are required (--least)"
    )


def _junit(suites: Mapping[str, Suite], hunted: Hunts) -> str:
    cases: dict[str, list[Case]] = {}
    for name, suite in suites.items():
        cases[name] = [_case(f"{name}.{c.rule}", c) for c in suite.checked]
        cases[name] += [
            Case(f"{name}.{lacking[0]}", "enough examples", "failure", _lacks(*lacking))
            for lacking in _lacking(suite)
        ]
        cases[name] += [_mutant(f"{name}.{m.where}.mutants", m) for m in hunted.get(name, ())]
    return render_junit("safestage rules test", cases)


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
