"""Bind files: roles, goal, rules and values for traces whose header does not say them.

::

    [task.pour_tea]                      # every episode of a task
    roles = { target = "pot", protected = ["phone", "book"] }
    rules = ["ETS201"]

    [episode."tea-17"]                   # one episode; it wins over its task
    roles = { target = "kettle" }

    [every]                              # every episode; tasks and episodes win over it
    roles = { fragile = "vase" }

    [body."cup_*"]                       # bodies by name or pattern, in every episode
    tags = ["fragile"]
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from safestage_eval.episode import Episode, Header, with_header
from safestage_eval.errors import RuleError, did_you_mean

from . import syntax as ast
from . import syntax_builder, table_checks
from .body_facts import BodyFacts, with_facts
from .check import check_goal
from .command_binding import CommandBinding, command_binding
from .condition_checks import Usage
from .diagnostic import Diagnostic, RuleErrors
from .files import RuleFile, builtin_folder, read_toml
from .locate import Keys
from .names import Names

BIND = "bind"
"""The folder of those that come along, among the rules."""

KINDS = ("task", "episode", "body")
"""Tables with one table per name or id."""

EVERY = "every"
"""The table about every episode."""


@dataclass(frozen=True)
class BindFile:
    """A checked bind file, and what the command line binds.

    Attributes:
        path: where it is, as messages say it; empty: there is no file.
        tasks, episodes: name or id → what is bound.
        every: what is bound in every episode, if anything is.
        bodies: name or pattern → what is said of the bodies.
        command: what the command line says of every episode.
    """

    path: str = ""
    tasks: Mapping[str, ast.TaskDef] = field(default_factory=dict)
    episodes: Mapping[str, ast.TaskDef] = field(default_factory=dict)
    every: ast.TaskDef | None = None
    bodies: Mapping[str, BodyFacts] = field(default_factory=dict)
    command: CommandBinding = field(default_factory=CommandBinding)

    def layers(self, header: Header) -> list[ast.TaskDef]:
        """The bindings of an episode: those of all, then of its task, then its own."""
        task, own = self.tasks.get(header.task or ""), self.episodes.get(header.episode_id)
        return [layer for layer in (self.every, task, own) if layer is not None]

    def described(self, episode: Episode) -> Episode:
        """The episode with what is said of its bodies; itself where nothing is."""
        bodies = tuple(with_facts(body, self.bodies) for body in episode.header.bodies)
        if bodies == episode.header.bodies:
            return episode
        return with_header(episode, episode.header.model_copy(update={"bodies": bodies}))

    def speaks_of(self, task: str | None, episode: str | None) -> bool:
        """Whether it says anything that may be about an episode."""
        general = self.every is not None or bool(self.bodies)
        return general or task in self.tasks or episode in self.episodes


def bind_names() -> list[str]:
    """Names of the bind files that come along: ``libero`` for LIBERO's task suites."""
    return sorted(path.stem for path in (builtin_folder() / BIND).glob("*.toml"))


def find_bind(spec: str | Path) -> Path:
    """The file of a built-in name, where no file has that name (a folder may); else the path itself."""
    path = Path(spec)
    if not path.is_file() and str(spec) in bind_names():
        return builtin_folder() / BIND / f"{spec}.toml"
    return path


def load_bind(path: str | Path, rules: ast.RuleSet) -> BindFile:
    """Read and check a bind file.

    Args:
        path: of a TOML file, or the name of a built-in one (``bind_names``).
        rules: the rule set that it will be used with, which knows parameters and goals.

    Raises:
        RuleErrors: with every problem of the file at once.
        RuleError: it cannot be opened.
    """
    shown = str(path)
    try:
        text, tables = read_toml(find_bind(path), shown)
    except OSError as error:
        raise RuleError(
            shown,
            f"cannot be read: {error.strerror}.",
            f"a TOML file, or a built-in name: {', '.join(bind_names())}",
        ) from None
    return bind_tables(tables, rules, shown, text)


def load_binding(
    bind: str | Path | None,
    rules: ast.RuleSet,
    assign: Sequence[str] = (),
    roles: Sequence[str] = (),
    protect: Sequence[str] = (),
) -> BindFile | None:
    """Bindings of a bind file and a command line; None where neither binds anything.

    Args:
        bind: as in ``load_bind``; None: no file.
        rules: the rule set that it will be used with.
        assign: codes; as in ``command_binding``, like the next two.
        roles: ``ROLE=BODIES``.
        protect: bodies.

    Raises:
        RuleErrors, RuleError: as ``load_bind`` and ``command_binding``.
    """
    command = command_binding(rules, assign, roles, protect)
    if bind is None:
        return BindFile(command=command) if command else None
    return replace(load_bind(bind, rules), command=command)


def bind_tables(
    tables: Mapping[str, Any], rules: ast.RuleSet, path: str = "bind file", text: str = ""
) -> BindFile:
    """Check a bind file given as tables: ``{"task": {name: {…}}, "episode": {id: {…}}}``.

    Raises:
        RuleErrors: with every problem at once.
    """
    checker = _Checker(rules, RuleFile(path, text, dict(tables), asked=True))
    tasks, episodes = checker.entries("task"), checker.entries("episode")
    every, bodies = checker.every(), checker.bodies()
    checker.strangers()
    if checker.problems:
        raise RuleErrors(checker.problems)
    return BindFile(path, tasks, episodes, every, bodies)


class _Checker:
    def __init__(self, rules: ast.RuleSet, file: RuleFile) -> None:
        self.problems: list[Diagnostic] = []
        self._rules, self._names, self._file = rules, Names.of_rules(rules), file
        self._usage = Usage(file, self._names, self.problems)

    def strangers(self) -> None:
        """Tables that a bind file does not have."""
        for name in self._file.table:
            if name not in (*KINDS, EVERY):
                self._usage.report(
                    "R201", (name,), f'a bind file has no table "{name}"',
                    "[every], [task.NAME], [episode.ID], [body.NAME]",
                    did_you_mean(name, (*KINDS, EVERY)), key=True,
                )  # fmt: skip

    def entries(self, kind: str) -> dict[str, ast.TaskDef]:
        """Name or id → what is bound, of one kind of table."""
        out = {}
        for name, table in self._tables(kind).items():
            before = len(self.problems)
            bound = self._entry(name, table, (kind, name))
            if len(self.problems) == before:
                out[name] = bound
        return out

    def every(self) -> ast.TaskDef | None:
        """Bindings that hold in every episode."""
        table = self._file.table.get(EVERY)
        return None if table is None else self._entry("", table, (EVERY,))

    def bodies(self) -> dict[str, BodyFacts]:
        """Name or pattern → what is said of the bodies."""
        out = {}
        for name, table in self._tables("body").items():
            good = table_checks.table(self._usage, "described", table, ("body", name))
            up = good.get("up")
            axis: tuple[float, ...] | Literal[False] | None = (
                up if up is None or up is False else tuple(map(float, up))
            )
            out[name] = BodyFacts(
                axis, good.get("finger"), good.get("material"), tuple(good.get("tags", ()))
            )
        return out

    def _tables(self, kind: str) -> Mapping[str, Any]:
        tables = self._file.table.get(kind, {})
        if isinstance(tables, Mapping):
            return tables
        self._usage.report("R203", (kind,), f'"{kind}" must be a table', f"[{kind}.NAME]")
        return {}

    def _entry(self, name: str, table: Any, keys: Keys) -> ast.TaskDef:
        good = table_checks.table(self._usage, "bound", table, keys)
        for index, code in enumerate(good.get("rules", ())):
            if not re.fullmatch(table_checks.CODE, code):
                self._usage.report(
                    "R203", (*keys, "rules", index), f'"{code}" is not a code',
                    "three capital letters and three digits: ETS101",
                )  # fmt: skip
        table_checks.players(self._usage, good, keys)
        for parameter, value in good.get("set", {}).items():
            self._usage.setting(parameter, value, (*keys, "set", parameter))
        goal = self._goal(good.get("goal"), (*keys, "goal"))
        if self.problems:
            return ast.TaskDef(name)
        return syntax_builder.task(name, {**good, "goal": goal})

    def _goal(self, goal: Any, keys: Keys) -> ast.GoalDef | str | None:
        if goal is None or isinstance(goal, str):
            return goal
        problems = check_goal(self._names, goal, self._file.path, self._file, keys)
        self.problems += problems
        builder = syntax_builder.Builder(frozenset(self._rules.phases))
        return None if problems else builder.goal("bind file", goal)
