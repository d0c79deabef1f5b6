"""The binding of an episode: its roles, goal, assigned rules and parameter values, and their sources.

``--assign``, ``--role`` and ``--set`` come first, then a bind file, the trace's header, the rule's own ``set``, and ``[param]``.
Where no source assigns rules, all those are assigned whose roles are bound.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from safestage_eval.episode import Header
from safestage_eval.errors import RuleError, nearest

from . import syntax as ast
from .bind_file import BindFile
from .check import read_goal
from .names import Names
from .overrides import parse_overrides, setting
from .role_players import bodies_of, demand_players

BY_ROLES = "no source assigns rules, and its roles are bound"
"""Provenance of rules that are assigned because every role has a body."""


@dataclass(frozen=True)
class Binding:
    """The roles, rules, goal and values of one episode.

    Attributes:
        roles: role → bodies.
        assigned: codes of the rules that are the task's evaluator.
        goal: native success in the rule language, None if it is not given or not loaded.
        family: of the task.
        provenance: ``roles.target``, ``rules``, ``goal``, ``family``, ``param.edge`` → where it
            comes from (``trace header``, ``bind file``, ``command line``, ``--set``; ``BY_ROLES`` for
            rules that no source assigns).
        notes: what was asked for and could not be found.
        rules: the rule set.
        values: parameters that have another value than the rule files give them, and that value.
        untagged: warnings about roles whose bodies lack the tag that rules ask for.
    """

    roles: Mapping[str, tuple[str, ...]]
    assigned: tuple[str, ...]
    goal: ast.GoalDef | None
    family: str | None
    provenance: Mapping[str, str]
    notes: tuple[str, ...]
    rules: ast.RuleSet = field(repr=False)
    values: Mapping[str, ast.Setting] = field(repr=False)
    untagged: tuple[str, ...] = ()

    def params(self, rule: ast.Scoped | None) -> dict[str, ast.Setting]:
        """Parameter values for a rule (None: for the goal), all sources applied in order."""
        own = dict(rule.set) if rule is not None else {}
        return {**self.rules.params, **own, **self.values}

    def sources(self, rule: ast.Scoped, used: Iterable[str]) -> tuple[str, ...]:
        """Where the rule's bodies and its own assignment come from, and values that are not its own.

        ``used``: names of the parameters that the rule reads. One text each, such as
        ``target = mug: trace header``, ``edge = 3 cm: --set``, ``assigned: bind file``.
        """
        lines = [
            f"{name} = {', '.join(self.roles[name])}: {self.provenance[f'roles.{name}']}"
            for name, _ in rule.roles
            if name in self.roles
        ]
        lines += [
            f"{name} = {self.values[name].text}: {self.provenance[f'param.{name}']}"
            for name in sorted(set(used) & self.values.keys())
        ]
        if rule.code in self.assigned:
            lines.append(f"assigned: {self.provenance['rules']}")
        return tuple(lines)

    def players(self, rule: ast.Scoped, header: Header) -> dict[str, tuple[str, ...]]:
        """Role of the rule → the bodies that play it; empty where none does."""
        return {name: bodies_of(name, spec, self.roles, header) for name, spec in rule.roles}

    def unbound(self, rule: ast.Scoped) -> tuple[str, ...]:
        """Roles of a rule that no source binds; an empty list binds a role to no body.

        ``every KIND`` is computed from the bodies of the trace, so it needs no binding.
        """
        return tuple(name for name, spec in rule.roles if name not in self.roles and not spec.every)

    def playable(self, rule: ast.Scoped, header: Header) -> bool:
        """Whether every role of a rule is bound to a body, each to a body of its own."""
        players = [bodies[: len(rule.roles)] for bodies in self.players(rule, header).values()]
        return all(players) and any(
            len({*bodies}) == len(bodies) for bodies in itertools.product(*players)
        )

    def misnamed(self, role: str) -> str:
        """The bound role that is probably meant by one that nothing binds; empty if none is near.

        Only names that no loaded rule or goal uses can be misspelt.
        """
        rules = self.rules
        scoped: list[ast.Scoped | ast.GoalDef] = [
            *rules.rules.values(), *rules.costs.values(), *rules.goals.values()
        ]  # fmt: skip
        used = {name for item in scoped for name, _ in item.roles}
        return nearest(role, [name for name in self.roles if name not in used])

    def binds_none(self, code: str, roles: Sequence[str]) -> str:
        """The warning about roles of an assigned rule that no source binds."""
        near = [
            f'; {self.provenance[f"roles.{wrong}"]} has "{wrong}", did you mean "{role}"?'
            for role in roles
            if (wrong := self.misnamed(role))
        ]
        several = "s" * (len(roles) > 1)
        return f"{code} is assigned, but nothing binds its role{several} {', '.join(roles)}" + (
            "".join(near)
        )

    def warnings(self) -> list[str]:
        """Warnings about roles that nothing binds, that are misspelt, or whose bodies lack the tag."""
        scoped = self.rules.scoped
        if self.provenance.get("rules", BY_ROLES) == BY_ROLES:
            unbound = {role for rule in scoped.values() for role in self.unbound(rule)}
            warnings = [
                f'{self.provenance[f"roles.{wrong}"]} has a role "{wrong}", did you mean "{role}"?'
                for role in sorted(unbound)
                if (wrong := self.misnamed(role))
            ]
        else:
            warnings = [
                self.binds_none(code, missing)
                for code in self.assigned
                if code in scoped and (missing := self.unbound(scoped[code]))
            ]
        return [*warnings, *self.untagged]

    def goal_players(self) -> dict[str, tuple[str, ...]]:
        """Role of the goal → bodies."""
        roles = self.goal.roles if self.goal is not None else ()
        return {name: self.roles.get(name, ()) for name, _ in roles}


def bind_episode(
    rules: ast.RuleSet,
    header: Header,
    *,
    bind: BindFile | None = None,
    overrides: Mapping[str, str] | None = None,
) -> Binding:
    """Resolve what holds for an episode.

    Args:
        rules: the rule set.
        header: of the trace.
        bind: a checked bind file.
        overrides: parameter → value as written on the command line.

    Raises:
        RuleError: an unknown parameter, a value of the wrong dimension, a role without a body, a
            goal that makes no sense.
    """
    layers = [("trace header", _from_header(rules, header))]
    layers += [("bind file", layer) for layer in (bind.layers(header) if bind else ())]
    if bind is not None and bind.command:
        said = {role: players for _, layer in layers for role, players in layer.roles}
        layers.append(("command line", bind.command.layer(header, said)))
    values: dict[str, ast.Setting] = {}
    roles: dict[str, tuple[str, ...]] = {}
    provenance: dict[str, str] = {}
    family: str | None = None
    goal: str | ast.GoalDef | None = None
    assigned: tuple[str, ...] = ()
    for source, layer in layers:
        for role, players in layer.roles:
            roles[role], provenance[f"roles.{role}"] = players, source
        for name, value in layer.set:
            values[name], provenance[f"param.{name}"] = value, source
        if layer.rules:
            assigned, provenance["rules"] = layer.rules, source
        if layer.goal:
            goal, provenance["goal"] = layer.goal, source
        if layer.family:
            family, provenance["family"] = layer.family, source
    goal_def, notes = _goal(rules, header, goal)
    demand_players(rules, goal_def, header, roles, provenance)
    chosen = parse_overrides(rules, overrides or {})
    values.update(chosen)
    provenance.update({f"param.{name}": "--set" for name in chosen})
    binding = Binding(roles, assigned, goal_def, family, provenance, notes, rules, values)
    if assigned:
        return replace(binding, untagged=tuple(_untagged(binding, assigned, header)))
    playable = tuple(code for code, rule in rules.scoped.items() if binding.playable(rule, header))
    sources = {**provenance, "rules": BY_ROLES} if playable else provenance
    untagged = tuple(_untagged(binding, rules.scoped, header))
    return replace(binding, assigned=playable, provenance=sources, untagged=untagged)


def _untagged(binding: Binding, codes: Iterable[str], header: Header) -> Iterator[str]:
    """Notes about roles whose bodies all lack the tag that rules ask for."""
    scoped, asked = binding.rules.scoped, defaultdict[tuple[str, str], list[str]](list)
    for code in codes:
        rule = scoped.get(code)
        players = binding.players(rule, header) if rule else {}
        for name, spec in rule.roles if rule else ():
            if spec.tag and binding.roles.get(name) and not players[name]:
                asked[name, spec.tag].append(code)
    for (role, tag), asking in sorted(asked.items()):
        bodies = ", ".join(map(repr, binding.roles[role]))
        yield (
            f"{binding.provenance[f'roles.{role}']} binds role {role} to {bodies}, not tagged "
            f'"{tag}": {", ".join(asking)} cannot use it. Add tags = ["{tag}"] to the body, in the '
            f"trace or under [body.NAME] in a --bind file"
        )


def _from_header(rules: ast.RuleSet, header: Header) -> ast.TaskDef:
    values = tuple(
        (name, setting(rules, name, text, f"trace header, parameter {name}"))
        for name, text in header.parameters.items()
        if name in rules.params  # a parameter of rules that are not loaded is of no concern here
    )
    goal = header.goal if isinstance(header.goal, str) else None
    roles = tuple(header.roles.items())
    return ast.TaskDef(header.task or "", header.family, header.rules, goal, roles, values)


def _goal(
    rules: ast.RuleSet, header: Header, name: str | ast.GoalDef | None
) -> tuple[ast.GoalDef | None, tuple[str, ...]]:
    if isinstance(name, ast.GoalDef):
        return name, ()
    if name is not None:
        if name in rules.goals:
            return rules.goals[name], ()
        return None, (f'goal "{name}" is not among the loaded rules: success is not recomputed',)
    if not isinstance(header.goal, dict):
        return None, ()
    problems, read = read_goal(Names.of_rules(rules), header.goal, "trace header")
    if problems:
        first = problems[0]
        raise RuleError("trace header, goal", f"{first.what}.", first.allowed, first.fix)
    return read, ()
