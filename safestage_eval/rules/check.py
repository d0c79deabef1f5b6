"""All checks of rule files, which report every problem at once before any file is used."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

from safestage_eval.relations.vocabulary import RELATIONS
from safestage_eval.signals import SIGNALS

from . import string_parser, table_checks
from . import syntax as ast
from .coherence_checks import Coherence
from .condition_checks import Usage
from .diagnostic import Diagnostic
from .files import RuleFile
from .locate import Keys
from .names import Names, Near, operands_of, table_of
from .obligation_checks import Obligations
from .operations import OPERATIONS, DimensionError, Operation, dimension_of_result
from .reference_checks import Read, Scope
from .signal_options import read_option
from .table_keys import NAMED, REPEATED, TABLES, TOP


def check(files: Sequence[RuleFile]) -> list[Diagnostic]:
    """All problems of files that were read together, in the order of files and lines."""
    names = Names.of_table(file.table for file in files)
    problems: list[Diagnostic] = []
    scopes: dict[Read, tuple[Usage, Scope]] = {}
    for file in files:
        checker = _FileChecker(Usage(file, names, problems))
        checker.run()
        scopes.update({read: (checker.usage, scope) for read, scope in checker.scopes.items()})
    Coherence(files, scopes, problems).run()
    return sorted(set(problems))


def check_goal(
    names: Names, table: Any, path: str, file: RuleFile | None = None, keys: Keys = ("goal",)
) -> list[Diagnostic]:
    """All problems of one goal table that stands in a trace's header or a bind file.

    ``file`` and ``keys``: where it stands; nowhere that could be shown if None.
    """
    problems: list[Diagnostic] = []
    checker = _FileChecker(Usage(file or RuleFile(path, "", {}, asked=True), names, problems))
    checker.goal(keys, table)
    return sorted(set(problems))


class _FileChecker(Obligations):
    """Walks the tables of one file."""

    def run(self) -> None:
        usage, table = self.usage, self.usage.file.table
        for name, value in table.items():
            if name not in TOP:
                usage.report(
                    "R201", (name,), f'a rule file has no table "{name}"', ", ".join(TOP),
                    Near(name, TOP), key=True,
                )  # fmt: skip
            elif name in REPEATED:
                if not isinstance(value, list):
                    usage.report(
                        "R203",
                        (name,),
                        f"[{name}] is repeated, one for each",
                        f"[[{name}]]",
                        key=True,
                    )
            elif not isinstance(value, dict):
                usage.report("R203", (name,), f'"{name}" must be a table', f"[{name}]", key=True)
        if "ruleset" not in table:
            usage.report(
                "R202", (), "the file does not say that it is a rule file",
                '[ruleset] format = 1, name = "…", version = "1.0.0"', "begin it with [ruleset]",
            )  # fmt: skip
        else:
            table_checks.table(usage, "ruleset", table["ruleset"], ("ruleset",))
        if "baseline" in table:
            self._baseline(table["baseline"])
        for name, value in table_of(table, "param").items():
            table_checks.declared_name(usage, name, ("param", name))
            usage.value_of(value, ("param", name))
        self._materials(table_of(table, "material").items())
        for kind in NAMED:
            for name, value in table_of(table, kind).items():
                self._named(kind, name, value)
        for kind in REPEATED:
            if usage.file.asked and isinstance(table.get(kind), list):
                for index, value in enumerate(table[kind]):
                    self.rule(kind, value, (kind, index))

    # ---- definitions

    def _baseline(self, table: Any) -> None:
        keys: Keys = ("baseline", "span")
        good = table_checks.table(self.usage, "baseline", table, ("baseline",))
        if "span" not in good:
            return
        scope = self.scope(("baseline", ""), "[baseline]", ())
        self.usage.span(good["span"], keys, scope)
        span = self.usage.parsed("R304", keys, string_parser.span, good["span"])
        if span is not None and not (
            isinstance(span, ast.Part)
            and span.which == "first"
            and isinstance(span.duration, ast.Duration)
            and isinstance(span.of, ast.Whole)
        ):
            self.usage.report(
                "R304", keys, "the baseline is the first frames of the episode",
                '"first 5 frames of episode", "first 0.1 s of episode"',
            )  # fmt: skip

    def _materials(self, rows: Iterable[tuple[str, Any]]) -> None:
        for name, row in rows:
            keys: Keys = ("material", name)
            table_checks.declared_name(self.usage, name, keys)
            if not isinstance(row, dict):
                self.usage.report(
                    "R203", keys, "a material is a table of columns", "[material.bottle]"
                )
                continue
            for column, value in row.items():
                at = (*keys, column)
                table_checks.declared_name(self.usage, column, at)
                quantity = self.usage.value_of(value, at)
                if isinstance(quantity, ast.Duration):
                    self.usage.report("R407", at, "a column holds quantities, not durations")

    def _named(self, kind: str, name: str, value: Any) -> None:
        keys: Keys = (kind, name)
        table_checks.declared_name(self.usage, name, keys)
        if kind in ("signal", "state", "phase"):
            taken = [
                k for k, table in (("signal", SIGNALS), ("relation", RELATIONS)) if name in table
            ]
            if taken:
                self.usage.report(
                    "R210", keys, f'"{name}" is a built-in {taken[0]}', "another name", key=True
                )
        if kind == "goal":
            self.goal(keys, value)
            return
        good = table_checks.table(self.usage, kind, value, keys)
        match kind:
            case "signal":
                self._signal(name, good, keys)
            case "state":
                self._state(name, good, keys)
            case "phase":
                self._phase(name, good, keys)
            case "family":
                self._assigned(good, keys)
            case "task":
                self._task(good, keys)

    def _signal(self, name: str, table: dict[str, Any], keys: Keys) -> None:
        base = table.get("base")
        operations = [key for key in OPERATIONS if key in table]
        if operations and (base is not None or len(operations) > 1):
            self.usage.report(
                "R205", (*keys, operations[-1]), f"signal {name} is said to be two things",
                f"base, or one of {', '.join(OPERATIONS)}", key=True,
            )  # fmt: skip
        elif operations:
            self._derived(name, operations[0], table, keys)
        elif base is None:
            self.usage.report(
                "R202", keys, f'[signal.{name}] needs "base", or an operation',
                f'base = "impact"; or one of {", ".join(OPERATIONS)} = [...]', key=True,
            )  # fmt: skip
        elif base not in SIGNALS:
            self.usage.report(
                "R401", (*keys, "base"), f'there is no built-in signal "{base}"',
                ", ".join(SIGNALS), Near(base, SIGNALS),
            )  # fmt: skip
        else:
            scope = self.scope(("signal", name), f"signal {name}", ())
            self._options(base, {k: v for k, v in table.items() if k != "base"}, keys, scope)

    def _derived(self, name: str, operation: Operation, table: dict[str, Any], keys: Keys) -> None:
        """A signal that is computed from others."""
        usage, at = self.usage, (*keys, operation)
        operands, spec = operands_of(table), OPERATIONS[operation]
        options = {"over"} if spec.over else set()
        for key in table.keys() - {"of", operation} - options:
            usage.report(
                "R414", (*keys, key), f'a signal that is computed by {operation} has no option "{key}"',
                f"of, {', '.join([operation, *options])}", key=True,
            )  # fmt: skip
        scope = self.formals("signal", name, table, keys)
        if "over" in table and spec.over:
            usage.lasting(table["over"], (*keys, "over"), scope)
        if not spec.least <= len(operands) <= spec.most:
            takes = "one signal" if spec.most == 1 else f"{spec.least} to {spec.most} operands"
            takes = "two operands" if spec.least == spec.most == 2 else takes
            usage.report(
                "R416", at, f"{operation} takes {takes}, not {len(operands)}", spec.meaning
            )
        count = 0
        look = self._state_operand if spec.of_state else self._operand
        for index, value in enumerate(operands):
            where = (*at, index) if isinstance(table[operation], list) else at
            count += look(value, where, scope)
        if operands and not count and not spec.of_state:
            usage.report("R416", at, "constants alone are no signal", "at least one signal")
        given = [usage.names.operand_dimension(one) for one in operands]
        if (
            count
            and not spec.of_state
            and None not in given
            and spec.least <= len(given) <= spec.most
        ):
            try:
                dimension_of_result(operation, [str(one) for one in given])
            except DimensionError as error:
                usage.report("R407", at, error.what, error.allowed)
        self.unused(scope, (*keys, "of"))

    def _state_operand(self, value: Any, keys: Keys, scope: Scope) -> bool:
        """Whether it is a state; what is wrong with it is reported."""
        call = self.usage.parsed("R307", keys, string_parser.call, str(value))
        if call is None:
            scope.unreadable()
            return False
        kind = self.usage.call(call, keys, scope)
        if kind == "signal":
            self.usage.report("R404", keys, f"{call.name}() is a signal", "a state or relation")
        return kind == "state"

    def _operand(self, value: Any, keys: Keys, scope: Scope) -> bool:
        """Whether it is a signal; what is wrong with it is reported."""
        usage = self.usage
        if isinstance(value, bool) or not isinstance(value, str | int | float):
            usage.report("R416", keys, "this is no operand", '"speed(a)", "2 cm", 0.5, a parameter')
            return False
        operand = usage.parsed("R416", keys, string_parser.operand, value)
        if operand is None:
            scope.unreadable()
        if isinstance(operand, ast.Parameter):
            usage.parameter(operand.name, keys, scope)
        if not isinstance(operand, ast.SignalAtom):
            return False
        if operand.since is not None:
            usage.moment(operand.since, keys, scope)
        kind = usage.call(operand.call, keys, scope)
        if kind == "state":
            usage.report("R404", keys, f"{operand.call.name}() is a state", "a signal")
        elif kind == "signal" and operand.since is not None:
            usage.since(operand.call, keys)
        return True

    def _options(self, base: str, given: dict[str, Any], keys: Keys, scope: Scope) -> None:
        options = {option.name: option for option in SIGNALS[base].options}
        for name, value in given.items():
            if name not in options:
                self.usage.report(
                    "R414", (*keys, name), f'{base}() has no option "{name}"',
                    ", ".join(options) or "base alone", Near(name, options), key=True,
                )  # fmt: skip
            else:
                self.usage.parsed("R414", (*keys, name), partial(read_option, options[name]), value)
                if options[name].param and isinstance(value, str):
                    self.usage.option_time(value, (*keys, name), scope)
        for option in options.values():
            if option.required and option.name not in given:
                self.usage.report(
                    "R414", keys, f'{base}() needs "{option.name}"', option.meaning, key=True
                )

    def _state(self, name: str, table: dict[str, Any], keys: Keys) -> None:
        scope = self.formals("state", name, table, keys)
        for key in ("when", "fallback", "perhaps", "also"):
            if key in table:
                self.usage.condition(table[key], (*keys, key), scope)
        for key in ("for", "gap"):
            if key in table:
                self.usage.lasting(table[key], (*keys, key), scope)
        if "until" in table:
            self.usage.event(table["until"], (*keys, "until"), scope)
        self.explain(table.get("explain", ""), (*keys, "explain"), scope, ("time",))
        self.unused(scope, (*keys, "of"))

    def _phase(self, name: str, table: dict[str, Any], keys: Keys) -> None:
        scope = self.formals("phase", name, table, keys)
        for key in ("span", "fallback"):
            if key in table:
                self.usage.span(table[key], (*keys, key), scope)
        self.unused(scope, (*keys, "of"))

    def goal(self, keys: Keys, value: Any) -> None:
        """``[goal.NAME]``."""
        table = table_checks.table(self.usage, "goal", value, keys)
        read = ("goal", str(keys[-1]))
        scope = self.roles(read, f"goal {keys[-1]}", table, keys, tuple(TABLES["goal"]))
        if "require" in table:
            self.usage.condition(table["require"], (*keys, "require"), scope)
        if "for" in table:
            self.usage.lasting(table["for"], (*keys, "for"), scope)
        self.unused(scope, (*keys, "roles"))

    def _task(self, table: dict[str, Any], keys: Keys) -> None:
        self._assigned(table, keys)
        declared = {"family": self.usage.names.families, "goal": self.usage.names.goals}
        for key, among in declared.items():
            if key in table and table[key] not in among:
                self.usage.report(
                    "R401", (*keys, key), f'there is no {key} "{table[key]}"',
                    ", ".join(sorted(among)) or f"a [{key}.NAME] of this file or one it extends",
                    Near(table[key], among),
                )  # fmt: skip
        table_checks.players(self.usage, table, keys)

    def _assigned(self, table: dict[str, Any], keys: Keys) -> None:
        for index, code in enumerate(table.get("rules", ())):
            if code not in self.usage.names.rules:
                self.usage.report(
                    "R401", (*keys, "rules", index), f'there is no rule "{code}"',
                    ", ".join(sorted(self.usage.names.rules)) or "codes of rules",
                    Near(code, self.usage.names.rules),
                )  # fmt: skip
        self.settings(table.get("set", {}), (*keys, "set"))
