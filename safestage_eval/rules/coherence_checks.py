"""Checks of all definitions together: no circles, no conflicts, nothing declared in vain."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from safestage_eval.evidence.declare import Relation, Signal
from safestage_eval.relations.vocabulary import RELATIONS
from safestage_eval.signals import SIGNALS

from .diagnostic import Diagnostic
from .files import RuleFile
from .locate import Keys
from .names import Names, table_of
from .read_values import Place, Read, Scope, Values

_Accepts = Callable[[Signal | Relation], bool]


def _union(spec: Signal | Relation) -> bool:
    return spec.groups


def _joint(spec: Signal | Relation) -> bool:
    return isinstance(spec, Signal) and spec.joints


DEEPEST = 100
"""Definitions that may rest on one another, one by way of the next."""

Scopes = Mapping[Read, tuple[Values, Scope]]
"""Definition or rule → the file that says it last, and what it uses."""


class Coherence:
    """Problems that show only when all definitions of all files are seen together."""

    def __init__(
        self, files: Sequence[RuleFile], scopes: Scopes, problems: list[Diagnostic]
    ) -> None:
        """``problems`` is added to."""
        self._files, self._scopes, self._problems = files, scopes, problems

    def run(self) -> None:
        """All checks."""
        self._conflicts()
        self._shared_names()
        self._circles()
        self._groups()
        self._joints()
        self._unread()
        self._vain_settings()

    def _conflicts(self) -> None:
        """Two files that do not extend one another must not mean two things by one name."""
        seen: dict[tuple[str, ...], list[tuple[RuleFile, Any, Keys]]] = {}
        for file in self._files:
            for name, value, keys in definitions(file):
                for other, meant, _ in seen.get(name, ()):
                    if other is file or (meant != value and not _related(file, other)):
                        here = "twice in this file" if other is file else f"in {other.path} too"
                        self._problems.append(
                            file.diagnostic(
                                "R106" if name[0] in ("rule", "cost") else "R105",
                                keys,
                                f"{' '.join(name)} is defined {here}, "
                                "and neither file extends the other"
                                if other is not file
                                else f"{' '.join(name)} is defined {here}",
                                fix="rename one, or let one file extend the other to override it",
                                key=name[0] not in ("rule", "cost"),
                            )
                        )
                        break
                seen.setdefault(name, []).append((file, value, keys))

    def _shared_names(self) -> None:
        """States, phases and signal variants are named alike in rules, so no two may share a name."""
        kinds: dict[str, tuple[str, RuleFile]] = {}
        for file in self._files:
            for kind in ("signal", "state", "phase"):
                for name in table_of(file.table, kind):
                    before, where = kinds.setdefault(name, (kind, file))
                    if before != kind:
                        self._problems.append(
                            file.diagnostic(
                                "R210", (kind, name),
                                f'"{name}" is a {before} already ({where.path})', key=True,
                            )
                        )  # fmt: skip

    def _circles(self) -> None:
        circles: set[frozenset[Read]] = set()
        heights: dict[Read, int] = {}
        too_deep = False

        def visit(read: Read, trail: tuple[Read, ...]) -> int:
            nonlocal too_deep
            if read in trail:
                circle = trail[trail.index(read) :]
                if frozenset(circle) not in circles:
                    circles.add(frozenset(circle))
                    usage, scope = self._scopes[read]
                    way = " → ".join(name for _, name in (*circle, read))
                    what = f"{scope.label} is defined by itself: {way}"
                    usage.report("R410", Place(read, key=True), what)
                return 0
            if read in heights or read not in self._scopes:
                return heights.get(read, 0)
            height = len(trail)
            if height < DEEPEST:
                below = sorted(self._scopes[read][1].reads)
                height = 1 + max((visit(other, (*trail, read)) for other in below), default=0)
            if height >= DEEPEST and not too_deep:
                too_deep = True
                usage, scope = self._scopes[read]
                what = f"{scope.label} rests on {DEEPEST} definitions, one on the other"
                usage.report("R410", Place(read, key=True), what)
            heights[read] = height
            return height

        for read in self._scopes:
            visit(read, ())

    def _groups(self) -> None:
        """``robot`` may be passed to a state only if all it ends up in can take several bodies."""
        for usage, scope in self._scopes.values():
            for callee, index, group, keys in scope.groups:
                blocking = self._takes_no(_union, callee, index, set())
                if blocking:
                    usage.report(
                        "R413", keys,
                        f"{callee}() asks for {blocking}(), which is about one body, and {group} "
                        "stands for several", "a role",
                    )  # fmt: skip

    def _joints(self) -> None:
        """A joint may be passed only to what is about joints."""
        for usage, scope in self._scopes.values():
            for (role, callee, index), keys in scope.passed.items():
                if scope.kinds.get(role) != "joint":
                    continue
                blocking = self._takes_no(_joint, callee, index, set())
                if blocking:
                    usage.report(
                        "R415", keys, f'{blocking}() is about bodies, and "{role}" is a joint',
                        "signals of joints: "
                        + ", ".join(spec.name for spec in SIGNALS.values() if spec.joints),
                    )  # fmt: skip

    def _takes_no(
        self, accepts: _Accepts, callee: str, index: int, seen: set[tuple[str, int]]
    ) -> str:
        """The built-in behind a name that does not accept a kind of argument; empty if all do."""
        if (callee, index) in seen:
            return ""
        seen.add((callee, index))
        names = next((usage.names for usage, _ in self._scopes.values()), Names())
        for kind in ("state", "phase", *(["signal"] if callee in names.derived else [])):
            if (kind, callee) in self._scopes:
                scope = self._scopes[kind, callee][1]
                if index >= len(scope.roles):
                    return ""
                for formal, inner, at in sorted(scope.passed):
                    if formal == scope.roles[index]:
                        blocking = self._takes_no(accepts, inner, at, seen)
                        if blocking:
                            return blocking
                return ""
        spec = names.signal(callee) or RELATIONS.get(callee)
        return callee if spec is not None and not accepts(spec) else ""

    def _unread(self) -> None:
        """In a file with rules, what it declares and nothing reads is a mistake."""
        reads = {
            read for owner, (_, scope) in self._scopes.items() for read in scope.reads - {owner}
        }
        for file in self._files:
            if not file.asked or not any(_definitions_of(file, kind) for kind in ("rule", "cost")):
                continue
            bases = [other for other in self._files if other.path in file.extends]
            for name, _, keys in definitions(file):
                kind = name[0]
                if kind not in ("param", "signal", "state", "phase", "material"):
                    continue
                if ("column" if kind == "material" else kind, name[-1]) in reads:
                    continue
                if any(name == other for base in bases for other, _, _ in definitions(base)):
                    continue
                self._problems.append(
                    file.diagnostic(
                        "R412", keys, f"{' '.join(name)} is declared, but nothing reads it",
                        fix="use it or leave it out", key=True,
                    )
                )  # fmt: skip

    def _vain_settings(self) -> None:
        """A rule that sets a parameter must read it, directly or through a definition."""
        for file in self._files:
            for kind in ("rule", "cost") if file.asked else ():
                for index, table in enumerate(_definitions_of(file, kind)):
                    code = table.get("code") if isinstance(table, dict) else None
                    if (kind, str(code)) not in self._scopes:
                        continue
                    reached = self._reached((kind, str(code)))
                    params = self._scopes[kind, str(code)][0].names.params
                    for name, keys in _set_by(table, (kind, index)):
                        if name in params and ("param", name) not in reached:
                            self._problems.append(
                                file.diagnostic(
                                    "R412", keys, f"{code} sets {name}, but never reads it",
                                    ", ".join(sorted(n for k, n in reached if k == "param")),
                                    key=True,
                                )
                            )  # fmt: skip

    def _reached(self, read: Read) -> set[Read]:
        reached: set[Read] = set()
        todo = [read]
        while todo:
            for other in self._scopes[todo.pop()][1].reads - reached:
                reached.add(other)
                if other in self._scopes:
                    todo.append(other)
        return reached


def definitions(file: RuleFile) -> Iterator[tuple[tuple[str, ...], Any, Keys]]:
    """Kind and name, value as written, and place of all that a file defines."""
    for kind in ("param", "signal", "state", "phase", "goal"):
        for name, value in table_of(file.table, kind).items():
            yield (kind, name), value, (kind, name)
    for material, row in table_of(file.table, "material").items():
        for column, value in row.items() if isinstance(row, dict) else ():
            yield ("material", material, column), value, ("material", material, column)
    if "baseline" in file.table:
        yield ("[baseline]",), file.table["baseline"], ("baseline",)
    for kind in ("rule", "cost"):
        for index, table in enumerate(_definitions_of(file, kind)):
            if isinstance(table, dict) and isinstance(table.get("code"), str) and file.asked:
                yield ("rule", table["code"]), table, (kind, index, "code")


def _definitions_of(file: RuleFile, kind: str) -> list[Any]:
    entries = file.table.get(kind)
    return entries if isinstance(entries, list) else []


def _set_by(table: dict[str, Any], keys: Keys) -> Iterator[tuple[str, Keys]]:
    tables = [(table.get("set"), (*keys, "set"))]
    levels = table.get("severity")
    for level, values in levels.items() if isinstance(levels, dict) else ():
        tables.append((values, (*keys, "severity", level)))
    for values, at in tables:
        for name in values if isinstance(values, dict) else ():
            yield name, (*at, name)


def _related(file: RuleFile, other: RuleFile) -> bool:
    return other.path in file.extends or file.path in other.extends
