"""docs/catalogue.md: every built-in rule, and which task family reads which parameter.

``python -m safestage_eval.report.catalogue docs/catalogue.md`` rewrites it from the rule files.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from safestage_eval.errors import InputError
from safestage_eval.rules import load_rules, syntax_words
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.digest import reached
from safestage_eval.rules.files import builtin_folder
from safestage_eval.rules.uses import Source, own_params, sources, uses_of
from safestage_eval.signals import SIGNALS
from safestage_eval.verdicts.players import nodes

from .document import markdown_lines
from .rule_report import obligations, rule_facts
from .table import Table

FAMILIES = {
    "ISH1": "stacking and support",
    "ISH2": "containment",
    "ETS1": "obstacle avoidance",
    "ETS2": "hazard-sensitive transport",
    "FSH1": "support and stability",
    "FSH2": "residual relation",
}
"""Beginning of a code → task family, as in table 2 of the SafeStage paper."""

FILES = ("ish", "ets", "fsh")
INTRO = """\
# Rule catalogue

<!-- Written by `make catalogue` from rules/*.toml; changes belong there. -->

Every built-in rule. The letters of its code are the stage, the first digit the task family. An episode is judged by the
rules that its header assigns; verdicts of other rules are listed as findings. The pictures show a scene that violates the rule
and one that passes; dashed is the start.

Limits are given with the name of their parameter. Rules that use states, such as `contact` or `moved`, also read the states'
parameters: see [the shared parameters](#the-shared-parameters). `safestage rules show CODE` prints all definitions and the names
of the examples, which are [sketches](../rules/examples); `safestage rules test` judges them. [meanings.md](meanings.md) defines
the words.
"""
SHARED = """\
## The shared parameters

All are defined in [rules/defaults.toml](../rules/defaults.toml). `--set NAME=VALUE` changes one for a run, a task's header
for its episodes. A dot means that a rule of the family reads the parameter, directly or through a state. [paper] is the
SafeStage paper, [RoboLab] the simulator that it used; *chosen* means that no published value was found.
"""
MATERIALS = """\
## Materials

Values that depend on the material of the body in a role. A material without a row, and an empty cell, take the
default.
"""


def catalogue() -> str:
    """The whole page.

    Raises:
        InputError: a rule whose code belongs to no family of ``FAMILIES`` would be left out.
    """
    rules, origins = load_rules(list(FILES)), sources(list(FILES))
    for code, rule in rules.rules.items():
        if code[:4] not in FAMILIES:
            raise InputError(
                str(rule.path),
                f"{code} belongs to no task family.",
                f"codes that begin with {', '.join(FAMILIES)}",
                "rename it, or add its family to FAMILIES in safestage_eval/report/catalogue.py",
            )
    lines = [INTRO, *_index(rules), "", *_rules(rules, origins), SHARED, *_shared(rules, origins)]
    return "\n".join([*lines, "", MATERIALS, *_materials(rules)]) + "\n"


def _index(rules: ast.RuleSet) -> Iterator[str]:
    """A row for each rule, which leads to it."""
    yield "| rule | family | asks |\n|---|---|---|"
    for family, name in FAMILIES.items():
        for code in sorted(rules.rules):
            if code.startswith(family):
                yield f"| [{code}](#{code.lower()}) | {name} | {rules.rules[code].title} |"


def _rules(rules: ast.RuleSet, origins: Mapping[str, Source]) -> Iterator[str]:
    for family, name in FAMILIES.items():
        yield f"## {family[:3]}: {name}\n"
        for code in sorted(rules.rules):
            if code.startswith(family):
                rule = rules.rules[code]
                own = {name: syntax_words.value(value) for name, value in rule.set}
                yield from _rule(rule_facts(rules, rule, origins), own)


def _rule(facts: Mapping[str, Any], own: Mapping[str, str]) -> Iterator[str]:
    yield f"### {facts['code']}\n"
    yield f"**{facts['title']}.** {facts['why']}\n"
    yield f"![{facts['code']}: violated, left, and passed, right](images/rules/{facts['code']}.svg)\n"
    roles = ", ".join(f"`{name}` ({text})" for name, text in facts["roles"].items())
    entries = {
        "roles": roles,
        "only if": f"{facts['given']}, in the first frames" if facts["given"] else "",
        "judged": facts["scope"] + (f", until {facts['until']}" if facts["until"] else ""),
        **{heading: "; ".join(texts) for heading, texts in obligations(facts)},
        "severity": "; ".join(
            f"{level}: also with {', '.join(f'{n} = {v}' for n, v in values.items())}"
            for level, values in facts["severity"].items()
        ),
        "own values": ", ".join(f"`{name}` {value}" for name, value in own.items()),
        "by material": ", ".join(dict.fromkeys(f"`{m['column']}`" for m in facts["materials"])),
        "trace needs": ", ".join(facts["needs"]),
        "examples": _counts(facts["examples"]),
    }
    yield from _table(("", ""), [(key, text) for key, text in entries.items() if text])
    yield ""


def _shared(rules: ast.RuleSet, origins: Mapping[str, Source]) -> Iterator[str]:
    """One table per heading of defaults.toml: value, source, and a column per family."""
    head = ("parameter", "value", "meaning and source", *FAMILIES)
    text = (builtin_folder() / "defaults.toml").read_text(encoding="utf-8")
    span = re.search(r'^span = "(.+?)" *# (.+)$', text, re.MULTILINE)
    yield "### baseline estimation\n"
    unit_cells = (span[1], span[2]) if span else ("", "")
    yield from _table(
        head, [("`[baseline]`", *unit_cells, *_dots(rules, partial(_reads_baseline, rules)))]
    )
    for heading, names in _headings(text).items():
        yield f"\n### {heading}\n"
        yield from _table(
            head,
            [
                (
                    f"`{name}`",
                    syntax_words.value(rules.params[name]),
                    origins[f"param.{name}"].comment,
                    *_dots(rules, partial(_reads, rules, name)),
                )
                for name in names
            ],
        )


def _headings(text: str) -> dict[str, list[str]]:
    """Heading in [param] of defaults.toml → the parameters under it."""
    result: dict[str, list[str]] = {}
    within = text.partition("\n[param]\n")[2].partition("\n# -----")[0]
    for line in within.splitlines():
        if line.startswith("# ---- "):
            result[line.removeprefix("# ---- ")] = []
        elif name := re.match(r"(\w+) *=", line):
            result[list(result)[-1]].append(name[1])
    return result


def _dots(rules: ast.RuleSet, reads: Callable[[ast.Rule], bool]) -> list[str]:
    """A dot for each family in which some rule reads it."""
    readers = {code[:4] for code, rule in rules.rules.items() if reads(rule)}
    return ["•" if family in readers else "" for family in FAMILIES]


def _reads(rules: ast.RuleSet, name: str, rule: ast.Rule) -> bool:
    """Whether a rule, or a definition that it reaches, reads a parameter."""
    return name in uses_of(rules, rule, own_params(rules, rule)).params


def _reads_baseline(rules: ast.RuleSet, rule: ast.Rule) -> bool:
    """Whether the rule measures from the initial state, or requires something of it."""
    parts = (rule, *reached(rules, rule, own_params(rules, rule)).values())
    return rule.given is not None or any(
        (atom.since is not None or SIGNALS[atom.call.name].from_start)
        for atom in nodes(parts)
        if isinstance(atom, ast.SignalAtom) and atom.call.name in SIGNALS
    )


def _materials(rules: ast.RuleSet) -> Iterator[str]:
    columns = list(rules.materials["default"])
    rows = [
        (
            f"`{name}`",
            *(syntax_words.value(row[column]) if column in row else "" for column in columns),
        )
        for name, row in rules.materials.items()
    ]
    yield from _table(("material", *(f"`{column}`" for column in columns)), rows)


def _counts(examples: Mapping[str, Sequence[str]]) -> str:
    """How many examples come out how."""
    words = {
        "violates": "violate", "passes": "pass", "vacuous": "have nothing to judge",
        "undecided": "stay undecided",
    }  # fmt: skip
    return ", ".join(f"{len(examples[k])} {word}" for k, word in words.items() if examples[k])


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    return markdown_lines(Table("", tuple(head), list(rows), len(head)))


if __name__ == "__main__":
    try:
        Path(sys.argv[1]).write_text(catalogue(), encoding="utf-8")
    except InputError as problem:
        sys.exit(f"error: {problem}")
