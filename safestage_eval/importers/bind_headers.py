"""A bind file whose roles, goal, rules and values go into the headers of what is imported."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from safestage_eval._text.toml_text import from_toml
from safestage_eval.episode import Header
from safestage_eval.errors import InputError
from safestage_eval.rules.body_facts import BodyFacts, with_facts

from .map_tables import MapFile


@dataclass(frozen=True)
class Bound:
    """A checked bind file as TOML gives it; picklable.

    Attributes:
        path: where it is.
        task, episode: name or id → ``{"roles": …, "goal": …, "rules": …, "set": …}``.
        every: such a table about every episode.
        bodies: name or pattern → what is said of the bodies.
    """

    path: str
    task: Mapping[str, Mapping[str, Any]]
    episode: Mapping[str, Mapping[str, Any]]
    every: Mapping[str, Any] = field(default_factory=dict)
    bodies: Mapping[str, BodyFacts] = field(default_factory=dict)

    def onto(self, header: Header, name: str) -> Header:
        """Return the header with the entries for its task, and for the episode by id or name in the source."""
        tables = (
            self.every,
            self.task.get(header.task or "", {}),
            self.episode.get(name, {}),
            self.episode.get(header.episode_id, {}),
        )
        for table in tables:
            roles = {
                role: (players,) if isinstance(players, str) else tuple(players)
                for role, players in table.get("roles", {}).items()
            }
            header = header.model_copy(
                update={
                    "family": table.get("family", header.family),
                    "roles": {**header.roles, **roles},
                    "goal": table.get("goal", header.goal),
                    "rules": tuple(table.get("rules", header.rules)),
                    "parameters": {**header.parameters, **table.get("set", {})},
                }
            )
        bodies = tuple(with_facts(body, self.bodies) for body in header.bodies)
        return header.model_copy(update={"bodies": bodies}) if self.bodies else header


def load_bound(path: str | Path, rules: Sequence[str | Path] = ()) -> Bound:
    """Read a bind file and check it against rule files (all built-in ones if none are given).

    Raises:
        RuleErrors, RuleError: it cannot be used.
    """
    from safestage_eval.rules import builtin_names, find_bind, load_bind, load_rules

    checked = load_bind(path, load_rules(list(rules) or builtin_names()))
    tables = from_toml(find_bind(path).read_text("utf-8"))
    return Bound(
        str(path),
        tables.get("task", {}),
        tables.get("episode", {}),
        tables.get("every", {}),
        checked.bodies,
    )


def demand_goals(map_: MapFile, rules: Sequence[str | Path] = ()) -> None:
    """Check the goals of a map file against rule files (all built-in ones if none are given).

    Raises:
        InputError: a goal of this name is not loaded, or a table of a goal cannot be used.
    """
    from safestage_eval.rules import builtin_names, load_rules
    from safestage_eval.rules.check import read_goal
    from safestage_eval.rules.names import Names

    tables = {"every": map_.every, **{f"task.{k}": v for k, v in map_.task.items()}}
    tables.update({f"episode.{name}": table for name, table in map_.episode.items()})
    goals = {name: table.goal for name, table in tables.items() if table.goal is not None}
    if not goals:
        return
    loaded = load_rules(list(rules) or builtin_names())
    for name, goal in goals.items():
        where = f"{map_.path}: [{name}] goal"
        if isinstance(goal, str) and goal not in loaded.goals:
            raise InputError(
                where, f"no goal {goal!r} is loaded.", ", ".join(sorted(loaded.goals)),
                "--rules FILE that has it, or a table: { roles = …, require = … } (docs/rules.md)",
            )  # fmt: skip
        problems = (
            [] if isinstance(goal, str) else read_goal(Names.of_rules(loaded), goal, where)[0]
        )
        if problems:
            raise InputError(where, f"{problems[0].what}.", problems[0].allowed, problems[0].fix)
