"""The tables of one rule file, read once: definitions, rules and costs of the syntax tree, or problems."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

from safestage_eval.relations.vocabulary import RELATIONS
from safestage_eval.signals import SIGNALS

from . import syntax as ast
from .clauses import CLAUSES
from .names import dimension_of, operands_of
from .operations import OPERATIONS, DimensionError, Operation, dimension_of_result
from .read_kinds import CODE, Kinds
from .read_values import Place, Read, Scope
from .signal_options import read_option, read_options
from .table_keys import GONE, NAMED, REPEATED, TABLES, TOP

WORDS = ("signal", "value", "limit", "margin", "time", "t.worst", "t.first")
"""Words that a rule's ``explain`` may use besides roles and states."""


DEFINITIONS = ("param", "material", *NAMED)
"""The tables whose entries are named, may be used by other files and may be overridden."""


class Tables(Kinds):
    """Reads the tables of one file.

    Attributes:
        scopes: definition or rule → what it uses.
    """

    scopes: dict[Read, Scope]

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.scopes = {}

    def bound_goal(self, value: Any, here: Place, _: Scope) -> str | ast.GoalDef | None:
        """The name of a goal, or one that is written out."""
        return value if isinstance(value, str) else self.goal("bind file", value, here)

    def scope(self, read: Read, label: str, roles: Any = (), kind: str = "") -> Scope:
        """An empty scope for a definition, kept under its kind and name."""
        named = tuple(role for role in roles if isinstance(role, str)) if isinstance(roles, list | dict) else ()  # fmt: skip
        scope = Scope(label, named, isinstance(roles, dict), tuple(TABLES[kind]) if kind else ())
        self.scopes[read] = scope
        return scope

    def _formals(self, kind: str, name: str, table: Any) -> Scope:
        of = table.get("of") if isinstance(table, dict) else None
        return self.scope((kind, name), f"{kind} {name}", of, kind)

    def _unused(self, scope: Scope, here: Place) -> None:
        """Report the roles that nothing named."""
        for index, role in enumerate(scope.roles):
            if role not in scope.used:
                at = here.inner(index if here.keys[-1] == "of" else role, key=True)
                what = f'"{role}" is a role of {scope.label}, but nothing in it names it'
                self.report("R411", at, what, fix="use it or leave it out")

    # ---- definitions

    def strangers(self) -> None:
        """What stands at the top of the file and should not, or stands there in the wrong shape."""
        for name, value in self.file.table.items():
            here = Place((name,), key=True)
            if name not in TOP:
                self.stranger(name, "a rule file", TOP, here)
            elif name in REPEATED and not isinstance(value, list):
                self.report("R203", here, f"[{name}] is repeated, one for each", f"[[{name}]]")
            elif name not in REPEATED and not isinstance(value, dict):
                self.report("R203", here, f'"{name}" must be a table', f"[{name}]")

    def head(self) -> dict[str, Any]:
        """``[ruleset]``."""
        if "ruleset" in self.file.table:
            return self.table("ruleset", self.file.table["ruleset"], Place(("ruleset",)), Scope(""))
        self.report(
            "R202", Place(()), "the file does not say that it is a rule file",
            '[ruleset] format = 1, name = "…", version = "1.0.0"', "begin it with [ruleset]",
        )  # fmt: skip
        return {}

    def baseline(self, table: Any) -> ast.Span | None:
        """``[baseline]``: the first frames."""
        scope = self.scope(("baseline", ""), "[baseline]")
        span = self.table("baseline", table, Place(("baseline",)), scope).get("span")
        first = isinstance(span, ast.Part) and span.which == "first"
        if span and not (first and isinstance(span.duration, ast.Duration) and isinstance(span.of, ast.Whole)):  # fmt: skip
            self.report(
                "R304", Place(("baseline", "span")), "the baseline is the first frames of the episode",
                '"first 5 frames of episode", "first 0.1 s of episode"',
            )  # fmt: skip
        return span

    def param(self, name: str, value: Any) -> ast.Setting | None:
        """``NAME = VALUE`` under ``[param]``."""
        here = Place(("param", name))
        self.declared_name(name, here)
        node = self.value_of(value, here)
        self.names.params[name] = None if node is None else dimension_of(node)
        return node

    def material(self, name: str, row: Any) -> dict[str, ast.Quantity | None]:
        """``[material.NAME]``: column → value; None for one that cannot be read."""
        here = Place(("material", name))
        self.declared_name(name, here)
        if not isinstance(row, dict):
            self.wrong(here, "a material is a table of columns", "[material.bottle]")
            return {}
        columns: dict[str, ast.Quantity | None] = {}
        for column, value in row.items():
            at = here.inner(column)
            self.declared_name(column, at)
            quantity = self.value_of(value, at)
            if isinstance(quantity, ast.Duration):
                self.report("R407", at, "a column holds quantities, not durations")
            columns[column] = quantity if isinstance(quantity, ast.Quantity) else None
            dimension = None if quantity is None else dimension_of(quantity)
            self.names.columns.setdefault(column, dimension)
        return columns

    def columns(
        self,
        name: str,
        row: Mapping[str, ast.Quantity | None],
        default: Mapping[str, ast.Quantity | None],
    ) -> None:
        """Whether the default row, which declares columns and their dimensions, has those of another."""
        for column, value in row.items():
            here, meant = Place(("material", name, column)), default.get(column)
            if column not in default:
                self.report(
                    "R409", here.at_key, f'[material.default] has no column "{column}"',
                    ", ".join(sorted(default)), "give the default row a value for it",
                )  # fmt: skip
            elif value is not None and meant is not None and value.dimension != meant.dimension:
                what = f"{column} is in {meant.dimension}, not in {value.dimension}"
                self.report("R407", here, what)

    def definition(self, kind: str, name: str, value: Any) -> Any:
        """``[state.NAME]`` and the like; None for one that lacks what it needs."""
        here = Place((kind, name))
        self.declared_name(name, here)
        if kind in ("signal", "state", "phase"):
            tables = (("signal", SIGNALS), ("relation", RELATIONS))
            for taken in [word for word, table in tables if name in table][:1]:
                what = f'"{name}" is a built-in {taken}'
                self.report("R210", here.at_key, what, "another name")
        read = {
            "signal": self._signal,
            "state": self._state,
            "phase": self._phase,
            "goal": self.goal,
        }
        return read[kind](name, value, here)

    def _state(self, name: str, value: Any, here: Place) -> ast.StateDef | None:
        scope = self._formals("state", name, value)
        good = self.table("state", value, here, scope)
        self.explain(good.get("explain", ""), here.inner("explain"), scope, ("time",))
        self._unused(scope, here.inner("of"))
        node: ast.StateDef | None = _built(ast.StateDef, name, good, ("of", "when"))
        return node

    def _phase(self, name: str, value: Any, here: Place) -> ast.PhaseDef | None:
        scope = self._formals("phase", name, value)
        good = {"of": (), **self.table("phase", value, here, scope)}
        self._unused(scope, here.inner("of"))
        node: ast.PhaseDef | None = _built(ast.PhaseDef, name, good, ("span",))
        return node

    def goal(self, name: str, value: Any, here: Place) -> ast.GoalDef | None:
        """``[goal.NAME]``, or one in a header or a bind file."""
        called = str(here.keys[-1])
        roles = value.get("roles", {}) if isinstance(value, dict) else {}
        scope = self.scope(("goal", called), f"goal {called}", roles, "goal")
        good = {"roles": (), **self.table("goal", value, here, scope)}
        self._unused(scope, here.inner("roles"))
        node: ast.GoalDef | None = _built(ast.GoalDef, name, good, ("require",))
        return node

    def _signal(self, name: str, value: Any, here: Place) -> ast.SignalDef | ast.DerivedDef | None:
        scope = self._formals("signal", name, value)
        table = self.table("signal", value, here, scope, skip=TABLES["signal"].keys() - {"of"})
        base = table.get("base")
        operations = [key for key in OPERATIONS if key in table]
        if operations and (base is not None or len(operations) > 1):
            what = f"signal {name} is said to be two things"
            allowed = f"base, or one of {', '.join(OPERATIONS)}"
            self.report("R205", here.inner(operations[-1], key=True), what, allowed)
        elif operations:
            return self._derived(name, operations[0], table, here, scope)
        elif isinstance(value, dict) and any(f"signal.{key}" in GONE for key in value):
            pass  # it names an operation that the language had
        elif base is None:
            what = f'[signal.{name}] needs "base", or an operation'
            allowed = f'base = "impact"; or one of {", ".join(OPERATIONS)} = [...]'
            self.report("R202", here.at_key, what, allowed)
        elif base not in SIGNALS:
            what = f'there is no built-in signal "{base}"'
            self.report("R401", here.inner("base"), what, ", ".join(SIGNALS), near=(base, SIGNALS))
        else:
            self.scope(("signal", name), f"signal {name}")
            return self._variant(name, base, table, here)
        return None

    def _derived(
        self, name: str, operation: Operation, table: dict[str, Any], here: Place, scope: Scope
    ) -> ast.DerivedDef | None:
        """A signal that is computed from others."""
        at, spec, given = here.inner(operation), OPERATIONS[operation], operands_of(table)
        options = ["over"] if spec.over else []
        for key in table.keys() - {"of", operation, *options}:
            what = f'a signal that is computed by {operation} has no option "{key}"'
            allowed = f"of, {', '.join([operation, *options])}"
            self.report("R414", here.inner(key, key=True), what, allowed)
        over = None
        if "over" in table and spec.over:
            over = self.lasting(table["over"], here.inner("over"), scope)
        if not spec.least <= len(given) <= spec.most:
            takes = "one signal" if spec.most == 1 else f"{spec.least} to {spec.most} operands"
            takes = "two operands" if spec.least == spec.most == 2 else takes
            what = f"{operation} takes {takes}, not {len(given)}"
            self.report("R416", at, what, spec.meaning)
        read = self.state_operand if spec.of_state else self.operand
        listed = isinstance(table[operation], list)
        nodes = [read(v, at.inner(i) if listed else at, scope) for i, v in enumerate(given)]
        measured = any(isinstance(node, ast.SignalAtom) for node in nodes)
        if given and not measured and not spec.of_state:
            self.report("R416", at, "constants alone are no signal", "at least one signal")
        self._unused(scope, here.inner("of"))
        signal = self.names.signal(name)
        if signal is None and measured and spec.least <= len(given) <= spec.most:
            dimensions = [self.names.operand_dimension(one) for one in given]
            try:
                if None not in dimensions:
                    dimension_of_result(operation, [str(one) for one in dimensions])
            except DimensionError as error:
                self.report("R407", at, error.what, error.allowed)
        operands = tuple(node for node in nodes if node is not None)
        if signal is None:
            return None
        return ast.DerivedDef(
            name, table.get("of", ()), operation, operands, signal.dimension, over
        )

    def _variant(
        self, name: str, base: str, table: dict[str, Any], here: Place
    ) -> ast.SignalDef | None:
        """A built-in signal with options of its own."""
        scope, before = self.scopes["signal", name], len(self.problems)
        options = {option.name: option for option in SIGNALS[base].options}
        for key in table.keys() - {"base"}:
            at, option = here.inner(key), options.get(key)
            if option is None:
                what, allowed = (
                    f'{base}() has no option "{key}"',
                    ", ".join(options) or "base alone",
                )
                self.report("R414", at.at_key, what, allowed, near=(key, options))
                continue
            value = self.parsed("R414", at, partial(read_option, option), table[key])
            self.timed(value if isinstance(value, ast.Parameter) else None, at, scope)
        for option in options.values():
            if option.required and option.name not in table:
                what = f'{base}() needs "{option.name}"'
                self.report("R414", here.at_key, what, option.meaning)
        sound = len(self.problems) == before
        return ast.SignalDef(name, base, read_options(table)) if sound else None

    # ---- rules and costs

    def judged(self, kind: str, value: Any, here: Place) -> ast.Scoped | None:
        """One ``[[rule]]`` or ``[[cost]]``; None for one that lacks what it needs."""
        given = value if isinstance(value, dict) else {}
        code = given.get("code")
        sound = isinstance(code, str) and re.fullmatch(CODE, code)
        read = (kind, str(code) if sound else f"#{here.keys[-1]}")
        roles = given.get("roles", {})
        scope = self.scope(read, str(code) if sound else f"this {kind}", roles, kind)
        good = self.table(kind, value, here, scope)
        for other in ("during", "until"):
            if "at" in given and other in given:
                what = f'"at" and "{other}" do not go together: "at" judges single frames'
                self.report("R205", here.inner(other, key=True), what, f'"at", or "{other}"')
        if kind == "rule":
            self._obligations(given, here, scope.label)
        elif "examples" in given and "budget" not in given:
            what = "a cost without a budget has no verdict that its examples could have"
            self.report("R205", here.inner("examples", key=True), what, "budget, or no examples")
        self.explain(good.get("explain", ""), here.inner("explain"), scope, WORDS)
        self._unused(scope, here.inner("roles"))
        if any(key.required and name not in good for name, key in TABLES[kind].items()):
            return None
        examples = good.pop("examples", {})
        line = self.file.locations.key(here.keys).line
        node: ast.Scoped = (ast.Rule if kind == "rule" else ast.Cost)(
            **{"roles": (), **_fields(good)}, **examples, path=self.file.path, line=line
        )
        return node

    def _obligations(self, given: dict[str, Any], here: Place, label: str) -> None:
        if not CLAUSES.keys() & given.keys():
            allowed = f"{_either(CLAUSES)}, or several of them"
            self.report("R202", here.at_key, f"{label} asks for nothing", allowed)
        lasting = _either(clause.kind for clause in CLAUSES.values() if clause.lasts)
        for kind, clause in CLAUSES.items():
            if kind in given and "for" in given and not clause.lasts:
                self.report(
                    "R208", here.inner("for", key=True), f'"for" does not apply to "{kind}", which '
                    "every frame must meet", f"for with {lasting}",
                    'forbid the opposite "for" that long, in a rule of its own',
                )  # fmt: skip


def _fields(good: dict[str, Any]) -> dict[str, Any]:
    """Keys as fields of the syntax tree."""
    return {"for_" if key == "for" else key: node for key, node in good.items()}


def _built(declared: Any, name: str, good: dict[str, Any], needed: tuple[str, ...]) -> Any:
    """A definition of what its table holds; None where it lacks what it needs."""
    return declared(name, **_fields(good)) if good.keys() >= {*needed} else None


def _either(names: Iterable[str]) -> str:
    """``require, forbid or reach``."""
    *others, last = names
    return f"{', '.join(others)} or {last}" if others else last
