"""What holds for one episode: its roles, goal, assigned rules and parameter values, and whence.

The rule file says most, then a bind file, then the trace's header; ``--set`` beats them all.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from safestage_eval.episode import Body, Header
from safestage_eval.errors import RuleError

from . import build, parse
from . import syntax as ast

Setting = ast.Quantity | ast.Duration


@dataclass(frozen=True)
class Binding:
    """What one episode brings to the rules.

    Attributes:
        roles: role → bodies.
        assigned: codes of the rules that are the task's evaluator.
        goal: native success in the rule language, None if it is not given or not loaded.
        family: of the task.
        provenance: ``roles.target``, ``param.edge``, … → where its value comes from.
    """

    roles: Mapping[str, tuple[str, ...]]
    assigned: tuple[str, ...]
    goal: ast.GoalDef | None
    family: str | None
    provenance: Mapping[str, str]
    _rules: ast.RuleSet = field(repr=False)
    _task: Mapping[str, Setting] = field(repr=False)
    _overrides: Mapping[str, Setting] = field(repr=False)

    def params(self, rule: ast.Rule | None) -> dict[str, Setting]:
        """Parameter values for a rule (None: for the goal), all sources applied in order."""
        own = dict(rule.set) if rule is not None else {}
        return {**self._rules.params, **own, **self._task, **self._overrides}

    def players(self, rule: ast.Rule, header: Header) -> dict[str, tuple[str, ...]]:
        """Role of the rule → the bodies that play it; empty where none does."""
        return {name: self._players(name, spec, header) for name, spec in rule.roles}

    def goal_players(self) -> dict[str, tuple[str, ...]]:
        """Role of the goal → bodies."""
        roles = self.goal.roles if self.goal is not None else ()
        return {name: self.roles.get(name, ()) for name, _ in roles}

    def _players(self, name: str, spec: ast.RoleSpec, header: Header) -> tuple[str, ...]:
        excluded = {body for role in spec.excluding for body in self.roles.get(role, ())}
        if spec.every:
            bodies = [b.name for b in header.bodies if _is_kind(b, spec.kind)]
        else:
            bodies = list(self.roles.get(name, ()))
        tags = {b.name: b.tags for b in header.bodies}
        return tuple(
            b for b in bodies if b not in excluded and (spec.tag is None or spec.tag in tags[b])
        )


def bind_episode(
    rules: ast.RuleSet,
    header: Header,
    *,
    bind: Mapping[str, Any] | None = None,
    overrides: Mapping[str, str] | None = None,
) -> Binding:
    """Resolve what holds for an episode.

    Args:
        rules: the rule set, with its ``[task.X]`` and ``[family.X]``.
        header: of the trace.
        bind: a bind file's tables: ``{"task": {name: {roles, goal, rules, set, family}}}``.
        overrides: parameter → value as written on the command line.

    Raises:
        RuleError: an unknown parameter, a value of the wrong dimension, a role without a body.
    """
    names = {body.name for body in header.bodies}
    task = header.task or ""
    bound = (bind or {}).get("task", {}).get(task)
    layers: list[tuple[str, ast.TaskDef]] = [("trace header", _from_header(rules, header))]
    if bound is not None:
        layers.append(("bind file", build.task(task, bound)))
    if task in rules.tasks:
        layers.append(("rule file", rules.tasks[task]))
    roles: dict[str, tuple[str, ...]] = {}
    values: dict[str, Setting] = {}
    provenance: dict[str, str] = {}
    family = assigned = goal = None
    for _, layer in layers:
        family = layer.family or family
    if family in rules.families:
        values.update(rules.families[family].set)
        assigned = rules.families[family].rules or None
        provenance.update({f"param.{n}": f"family {family}" for n in values})
    for source, layer in layers:
        for role, players in layer.roles:
            roles[role], provenance[f"roles.{role}"] = players, source
        for name, value in layer.set:
            values[name], provenance[f"param.{name}"] = value, source
        if layer.rules:
            assigned, provenance["rules"] = layer.rules, source
        if layer.goal:
            goal, provenance["goal"] = layer.goal, source
    for role, players in roles.items():
        for player in players:
            if player not in names:
                raise RuleError(
                    f"task {task!r}, role {role!r} ({provenance[f'roles.{role}']})",
                    f"{player!r} is no body of the trace.",
                    ", ".join(sorted(names)),
                )
    for name in values:
        _known(rules, name, f"task {task!r} ({provenance[f'param.{name}']})")
    chosen = parse_overrides(rules, overrides or {})
    provenance.update({f"param.{name}": "--set" for name in chosen})
    return Binding(
        roles, tuple(assigned or ()), _goal(rules, header, goal), family, provenance,
        rules, values, chosen,
    )  # fmt: skip


def parse_overrides(rules: ast.RuleSet, overrides: Mapping[str, str]) -> dict[str, Setting]:
    """``{"edge": "3 cm"}`` → values, checked against the parameters' dimensions."""
    found = {}
    for name, text in overrides.items():
        where = f"--set {name}={text}"
        _known(rules, name, where)
        try:
            value = parse.setting(text)
        except parse.GrammarError as problem:
            raise RuleError(where, f"{problem.what}.", problem.allowed) from None
        wanted, given = _dimension(rules.params[name]), _dimension(value)
        if wanted != given:
            raise RuleError(
                where,
                f"{name} is a {wanted}, {text!r} a {given}.",
                f"a {wanted}, such as {_example(rules.params[name])!r}",
            )
        found[name] = value
    return found


def _from_header(rules: ast.RuleSet, header: Header) -> ast.TaskDef:
    # a parameter of rules that are not loaded is of no concern here
    values = {n: v for n, v in header.parameters.items() if n in rules.params}
    try:
        settings = build.settings(values)
    except parse.GrammarError as problem:
        raise RuleError("trace header, parameters", problem.what, problem.allowed) from None
    goal = header.goal if isinstance(header.goal, str) else None
    return ast.TaskDef(
        header.task or "", header.family, header.rules, goal, tuple(header.roles.items()), settings
    )


def _goal(rules: ast.RuleSet, header: Header, name: str | None) -> ast.GoalDef | None:
    if name is not None:
        return rules.goals.get(name)
    if isinstance(header.goal, dict):
        try:
            return build.Builder(frozenset(rules.phases)).goal("header", header.goal)
        except (parse.GrammarError, KeyError, TypeError) as problem:
            raise RuleError("trace header, goal", f"not a goal: {problem}") from None
    return None


def _known(rules: ast.RuleSet, name: str, where: str) -> None:
    if name in rules.params:
        return
    near: Sequence[str] = difflib.get_close_matches(name, rules.params, 1)
    raise RuleError(
        where,
        f"no loaded rule file has a parameter {name!r}.",
        ", ".join(sorted(rules.params)),
        f"did you mean {near[0]!r}?" if near else "",
    )


def _dimension(value: Setting) -> str:
    return value.dimension if isinstance(value, ast.Quantity) else "duration"


def _example(value: Setting) -> str:
    return value.text


def _is_kind(body: Body, kind: str) -> bool:
    if kind == "body":
        return True
    if kind == "link":
        return body.kind in ("robot", "gripper")
    if kind == "container":
        return body.cavity is not None
    if kind == "surface":
        return body.kind in ("object", "fixture")
    return body.kind == kind
