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

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from safestage_eval.episode import Episode, Header, with_header
from safestage_eval.errors import RuleError

from . import syntax as ast
from .body_facts import BodyFacts, with_facts
from .check import check_passed
from .command_binding import CommandBinding, command_binding
from .diagnostic import RuleErrors
from .entry import Reading
from .files import RuleFile, builtin_folder, read_toml
from .names import Names
from .tables import Entry

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
    reading = Reading(Names.of_rules(rules))
    page = Entry(reading, RuleFile(path, text, dict(tables), asked=True), (), tables)
    said: dict[str, dict[str, Any]] = {kind: {} for kind in KINDS}
    every = None
    for kind, named in tables.items():
        entry = page.inner(kind)
        if kind == EVERY:
            every = ast.TaskDef("", **entry.table("bound"))
        elif kind not in KINDS:
            known = (*KINDS, EVERY)
            allowed = "[every], [task.NAME], [episode.ID], [body.NAME]"
            what = f'a bind file has no table "{kind}"'
            entry.key.report("R201", what, allowed, near=(kind, known))
        elif not isinstance(named, Mapping):
            entry.report("R203", f'"{kind}" must be a table', f"[{kind}.NAME]")
        else:
            for name in named:
                told = entry.inner(name).table("described" if kind == "body" else "bound")
                said[kind][name] = (
                    BodyFacts(**told) if kind == "body" else ast.TaskDef(name, **told)
                )
    check_passed(reading)
    if reading.problems:
        raise RuleErrors(reading.problems)
    return BindFile(path, said["task"], said["episode"], every, said["body"])
