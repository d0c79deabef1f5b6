"""Rule files that were read together: every problem of them at once, and the rule set that they mean."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from typing import Any

from safestage_eval.evidence.declare import Signal
from safestage_eval.relations.vocabulary import GROUPS
from safestage_eval.signals import SIGNALS

from . import string_parser
from . import syntax as ast
from .diagnostic import Diagnostic
from .entry import Read, Reading, Scope
from .files import RuleFile
from .locate import Keys
from .names import DEEPEST, Names, dimension_of, table_of
from .table_keys import NAMED, REPEATED, TOP
from .tables import Entry


def check(files: Sequence[RuleFile]) -> list[Diagnostic]:
    """All problems of files that were read together, in the order of files and lines."""
    return read(files)[0]


def read(files: Sequence[RuleFile]) -> tuple[list[Diagnostic], ast.RuleSet]:
    """All problems, in the order of files and lines, and what the files mean together.

    A later definition of a name replaces an earlier one; what cannot be read is left out.
    """
    reading = Reading()
    names = reading.names
    pages = [Entry(reading, file, (), file.table) for file in files]
    heads: list[dict[str, Any]] = []
    params: dict[str, Any] = {}
    rows: list[tuple[str, dict[str, tuple[Entry, ast.Setting | None]]]] = []
    for page in pages:  # first what names stand for, then what uses them
        _strangers(page)
        heads += [head for head in (_head(page),) if page.file.asked]
        for name, entry in page.named("param"):
            value = params[name] = entry.setting()
            names.params[name] = None if value is None else dimension_of(value)
        for name, row in page.named("material"):
            rows.append((name, {column: (cell, cell.setting()) for column, cell in row.named()}))
        for name, entry in page.named("phase"):
            names.declare("phase", name, entry.value)
        for name, entry in page.named("state"):
            names.declare("state", name, entry.value)
        for name, entry in page.named("signal"):
            names.expect(name, partial(entry.definition, "signal", name))
    materials = _materials(rows, names)
    own = list(names.unread)
    defined: dict[str, dict[str, Any]] = {"state": {}, "phase": {}, "goal": {}}
    judged: dict[str, dict[str, Any]] = {kind: {} for kind in REPEATED}
    baseline: ast.Span | None = string_parser.span("first 5 frames of episode")
    for page in pages:
        if "baseline" in page.value:
            baseline = _baseline(page.inner("baseline"))
        for kind, nodes in defined.items():
            for name, entry in page.named(kind):
                nodes[name] = entry.definition(kind, name)
        for kind, index in _judged(page.file):
            node = page.inner(kind).inner(index).definition(kind)
            judged[kind].update({} if node is None else {node.code: node})
    for name in own:
        names.find(name)
    _together(reading, files)
    signals = {name: names.signals.get(name) for name in own}.items()
    return sorted(set(reading.problems)), ast.RuleSet(
        name="+".join(head.get("name", "") for head in heads),
        version="+".join(dict.fromkeys(head.get("version", "") for head in heads)),
        baseline=baseline or ast.Whole(),
        params=params,
        materials=materials,
        signals={name: one for name, one in signals if isinstance(one, ast.SignalDef)},
        states=defined["state"],
        phases=defined["phase"],
        goals=defined["goal"],
        rules=judged["rule"],
        costs=judged["cost"],
        derived={name: one for name, one in signals if isinstance(one, ast.DerivedDef)},
    )


def read_goal(names: Names, table: Any, path: str) -> tuple[list[Diagnostic], ast.GoalDef | None]:
    """All problems of one goal table in a trace's header, and what it means if there is none."""
    reading = Reading(names)
    entry = Entry(reading, RuleFile(path, "", {}, asked=True), ("goal",), table)
    goal = entry.definition("goal", "header")
    check_passed(reading)
    return sorted(set(reading.problems)), None if reading.problems else goal


def _strangers(page: Entry) -> None:
    """What stands at the top of a file and should not."""
    for name, value in page.value.items():
        entry = page.inner(name)
        if name not in TOP:
            entry.stranger(name, "a rule file", TOP)
        elif name in REPEATED and not isinstance(value, list):
            entry.key.wrong(f"[{name}] is repeated, one for each", f"[[{name}]]")


def _head(page: Entry) -> dict[str, Any]:
    """``[ruleset]``."""
    if "ruleset" in page.value:
        return page.inner("ruleset").table("ruleset")
    allowed = '[ruleset] format = 1, name = "…", version = "1.0.0"'
    what = "the file does not say that it is a rule file"
    page.report("R202", what, allowed, "begin it with [ruleset]")
    return {}


def _baseline(entry: Entry) -> ast.Span | None:
    """``[baseline]``: the first frames."""
    entry.scope = Scope("[baseline]")
    entry.reading.scopes["baseline", ""] = entry.scope, entry
    span: ast.Span | None = entry.table("baseline").get("span")
    match span:
        case None | ast.Part("first", ast.Duration(), ast.Whole()):
            return span
    allowed = '"first 5 frames of episode", "first 0.1 s of episode"'
    entry.inner("span").report("R304", "the baseline is the first frames of the episode", allowed)
    return span


def _materials(
    rows: Sequence[tuple[str, dict[str, tuple[Entry, ast.Setting | None]]]], names: Names
) -> dict[str, dict[str, ast.Quantity]]:
    """Material → column → value; the default row, which declares the columns, must have each."""
    default: dict[str, ast.Setting | None] = {}
    materials: dict[str, dict[str, ast.Quantity]] = {"default": {}}
    for name, cells in rows:
        if name == "default":
            default = {**{column: value for column, (_, value) in cells.items()}, **default}
    for name, cells in rows:
        row = materials.setdefault(name, {})
        for column, (cell, value) in cells.items():
            given = None if value is None else dimension_of(value)
            meant = default.get(column)
            names.columns.setdefault(column, given)
            if isinstance(value, ast.Quantity):
                row[column] = value
            elif value is not None:
                cell.report("R407", "a column holds quantities, not durations")
            if column not in default:
                what, known = f'[material.default] has no column "{column}"', sorted(default)
                cell.key.report("R409", what, ", ".join(known), "give the default row a value for it")  # fmt: skip
            elif value is not None and meant is not None:
                cell.fits(given, dimension_of(meant), f'"{value.text}"', column)
    return materials


# ---- all definitions together: no circles, no conflicts, nothing declared in vain


def _together(reading: Reading, files: Sequence[RuleFile]) -> None:
    _conflicts(reading, files)
    _circles(reading)
    check_passed(reading)
    _unread(reading, files)
    _vain_settings(reading)


def _conflicts(reading: Reading, files: Sequence[RuleFile]) -> None:
    """Two files that do not extend one another must not mean two things by one name."""
    seen: dict[tuple[str, ...], list[tuple[RuleFile, Any]]] = {}
    kinds: dict[str, tuple[str, RuleFile]] = {}
    for file in files:
        for name, value, keys in definitions(file):
            entry = Entry(reading, file, keys, value)
            entry = entry if name[0] == "rule" else entry.key
            for other, meant in seen.get(name, ()):
                related = other.path in file.extends or file.path in other.extends
                if other is file or (meant != value and not related):
                    where = f"in {other.path} too, and neither file extends the other"
                    where = "twice in this file" if other is file else where
                    fix = "rename one, or let one file extend the other to override it"
                    code = "R106" if name[0] == "rule" else "R105"
                    entry.report(code, f"{' '.join(name)} is defined {where}", fix=fix)
                    break
            seen.setdefault(name, []).append((file, value))
            if name[0] in ("signal", "state", "phase"):  # these are named alike in rules
                before, there = kinds.setdefault(name[1], (name[0], file))
                if before != name[0]:
                    what = f'"{name[1]}" is a {before} already ({there.path})'
                    entry.report("R210", what)


def _circles(reading: Reading) -> None:
    """No definition may rest on itself, nor on too many others."""
    circles: set[frozenset[Read]] = set()
    heights: dict[Read, int] = {}

    def visit(one: Read, trail: tuple[Read, ...]) -> int:
        scope, entry = reading.scopes[one]
        if one in trail:
            circle = trail[trail.index(one) :]
            if frozenset(circle) not in circles:
                circles.add(frozenset(circle))
                way = " → ".join(name for _, name in (*circle, one))
                entry.key.report("R410", f"{scope.label} is defined by itself: {way}")
            return 0
        if one not in heights and len(trail) < DEEPEST:
            below = [other for other in sorted(scope.reads) if other in reading.scopes]
            heights[one] = 1 + max([visit(other, (*trail, one)) for other in below], default=0)
        return heights.get(one, DEEPEST)

    for one in reading.scopes:
        visit(one, ())
    deep = [one for one, height in heights.items() if height >= DEEPEST]
    for scope, entry in [reading.scopes[one] for one in deep[:1]]:
        what = f"{scope.label} rests on {DEEPEST} definitions, one on the other"
        entry.key.report("R410", what)


def check_passed(reading: Reading) -> None:
    """``robot`` may be passed only to what takes several bodies, a joint only to what is about joints."""
    for scope, _ in reading.scopes.values():
        for (arg, callee, index), (entry, word) in scope.passed.items():
            union = arg in GROUPS
            if not union and scope.kinds.get(arg) != "joint":
                continue
            blocking = _blocking(reading, union, callee, index, set())
            if not blocking:
                continue
            direct = blocking == callee
            who = f"{callee}()" if direct else f"{callee}() asks for {blocking}(), which"
            if union:
                takers = [n for n, s in SIGNALS.items() if s.groups and len(s.args) == 2]
                what = f"{who} is about one body, and {arg} stands for several"
                allowed = f"a role; these take {arg}: {', '.join(sorted(takers))}"
                entry.report("R413", what, allowed, word=word if direct else None)
            else:
                joints = ", ".join(spec.name for spec in SIGNALS.values() if spec.joints)
                what = f'{who} is about bodies, and "{arg}" is a joint'
                entry.report("R415", what, f"signals of joints: {joints}")


def _blocking(
    reading: Reading, union: bool, callee: str, index: int, seen: set[tuple[str, int]]
) -> str:
    """The built-in behind a name that takes no union of bodies, or no joint; empty if all do."""
    found = reading.names.called.get(callee)
    if found is None or (callee, index) in seen:
        return ""
    seen.add((callee, index))
    spec, (scope, _) = found.spec, reading.scopes.get((found.kind, callee), (None, None))
    if scope is not None and index < len(scope.roles):
        inner = sorted((name, at) for arg, name, at in scope.passed if arg == scope.roles[index])
        behind = (_blocking(reading, union, name, at, seen) for name, at in inner)
        return next(filter(None, behind), "")
    takes = spec is None or (spec.groups if union else isinstance(spec, Signal) and spec.joints)
    return "" if takes else callee


def _unread(reading: Reading, files: Sequence[RuleFile]) -> None:
    """In a file with rules, what it declares and nothing reads is a mistake.

    Not where something else is wrong in the file: a misspelt name may be what was to read it.
    """
    scopes, wrong = reading.scopes.items(), {problem.path for problem in reading.problems}
    reads = {read for owner, (scope, _) in scopes for read in scope.reads - {owner}}
    for file in files:
        if not any(_judged(file)) or file.path in wrong:
            continue
        bases = [other for other in files if other.path in file.extends]
        inherited = {name for base in bases for name, _, _ in definitions(base)}
        for name, value, keys in definitions(file):
            kind = "column" if name[0] == "material" else name[0]
            may_be_read = kind in ("param", "column", "signal", "state", "phase")
            if may_be_read and name not in inherited and (kind, name[-1]) not in reads:
                what = f"{' '.join(name)} is declared, but nothing reads it"
                entry = Entry(reading, file, keys, value).key
                entry.report("R412", what, fix="use it or leave it out")


def _vain_settings(reading: Reading) -> None:
    """A rule that sets a parameter must read it, directly or through a definition."""
    for (kind, code), (_, entry) in reading.scopes.items():
        if kind not in REPEATED or not isinstance(entry.value, dict):
            continue
        levels = table_of(entry.value, "severity")
        places: list[Keys] = [("set", name) for name in table_of(entry.value, "set")]
        places += [("severity", n, name) for n in levels for name in table_of(levels, n)]
        reached = _reached(reading, (kind, code)) if places else set()
        for keys in places:
            name = str(keys[-1])
            if name in reading.names.params and ("param", name) not in reached:
                known = ", ".join(sorted(name for kind, name in reached if kind == "param"))
                there = Entry(reading, entry.file, (*entry.keys, *keys), None)
                there.key.report("R412", f"{code} sets {name}, but never reads it", known)


def _reached(reading: Reading, one: Read) -> set[Read]:
    """All that a definition reads, directly or through others."""
    reached: set[Read] = set()
    todo = [one]
    while todo:
        scope, _ = reading.scopes.get(todo.pop(), (None, None))
        if scope is not None:
            todo += scope.reads - reached
            reached |= scope.reads
    return reached


def definitions(file: RuleFile) -> Iterator[tuple[tuple[str, ...], Any, Keys]]:
    """Kind and name, value as written, and place of all that a file defines."""
    for kind in ("param", *NAMED):
        for name, value in table_of(file.table, kind).items():
            yield (kind, name), value, (kind, name)
    for material, row in table_of(file.table, "material").items():
        for column, value in row.items() if isinstance(row, dict) else ():
            yield ("material", material, column), value, ("material", material, column)
    if "baseline" in file.table:
        yield ("[baseline]",), file.table["baseline"], ("baseline",)
    for kind, index in _judged(file):
        table = file.table[kind][index]
        if isinstance(table, dict) and isinstance(table.get("code"), str):
            yield ("rule", table["code"]), table, (kind, index, "code")


def _judged(file: RuleFile) -> Iterator[tuple[str, int]]:
    """The rules and costs of a file that is asked for."""
    for kind in REPEATED if file.asked else ():
        entries = file.table.get(kind)
        for index in range(len(entries) if isinstance(entries, list) else 0):
            yield kind, index
