"""Roles and rules from the command line: ``--assign FSH101 --role target=cube --protect "vase,glass*"``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from safestage_eval._text.plural import first_few
from safestage_eval.episode import Header
from safestage_eval.errors import RuleError, did_you_mean

from . import syntax as ast

PROTECTED = "protected"
"""The role that ``--protect`` binds."""

SHOWN = 20
"""Names listed in a message; of more, the number."""


@dataclass(frozen=True)
class CommandBinding:
    """Bindings from the command line for every episode; they override every other source.

    Attributes:
        rules: codes of the assigned rules; empty: as the other sources say.
        roles: role → names of bodies, or patterns of such names; none: no body plays it.
    """

    rules: tuple[str, ...] = ()
    roles: tuple[tuple[str, tuple[str, ...]], ...] = ()

    def __bool__(self) -> bool:
        """Whether it says anything."""
        return bool(self.rules or self.roles)

    def layer(self, header: Header, known: Mapping[str, Sequence[str]]) -> ast.TaskDef:
        """Bindings for one episode.

        A name must be a body or joint of the trace. A pattern stands for all objects it fits, for all
        other bodies and joints outside the robot where it fits no object, and never for what plays
        another role; it may fit none as long as the role gets a body.

        Args:
            header: of the trace.
            known: role → bodies, from the other sources.

        Raises:
            RuleError: a name that the trace lacks, or a role without a body.
        """
        asked = dict(self.roles)
        names = {body.name for body in header.bodies} | {joint.name for joint in header.joints}
        others = {role: players for role, players in known.items() if role not in asked}
        others |= {role: [p for p in players if p in names] for role, players in self.roles}
        roles = []
        for role, patterns in self.roles:
            taken = {body for other, bodies in others.items() if other != role for body in bodies}
            codes: dict[str, None] = {}
            for pattern in patterns:
                codes |= dict.fromkeys(_matches(role, pattern, header, taken))
            if patterns and not codes:
                raise _no_body(role, ",".join(patterns), header)
            roles.append((role, tuple(codes)))
        return ast.TaskDef(header.task or "", rules=self.rules, roles=tuple(roles))


def command_binding(
    rules: ast.RuleSet,
    assign: Iterable[str] = (),
    roles: Iterable[str] = (),
    protect: Iterable[str] = (),
) -> CommandBinding:
    """Check what was given on the command line.

    Args:
        rules: those that are loaded.
        assign: codes, or patterns of codes, several with commas: ``FSH101,ETS1*``.
        roles: ``ROLE=BODIES`` with commas between names or patterns; no name: no body plays it.
        protect: bodies for the role ``protected``.

    Raises:
        RuleError: a code or role that no loaded rule has, or no ``ROLE=BODIES``.
    """
    codes: dict[str, None] = {}
    for wanted in _parts(assign):
        fitting = [code for code in rules.scoped if fnmatchcase(code, wanted)]
        if not fitting:
            raise RuleError(
                f"--assign {wanted}",
                "no loaded rule has this code.",
                ", ".join(rules.scoped),
                did_you_mean(wanted, rules.scoped) or "load its file with --rules",
            )
        codes |= dict.fromkeys(fitting)
    known = {
        role for item in (*rules.scoped.values(), *rules.goals.values()) for role, _ in item.roles
    }
    bound: dict[str, tuple[str, ...]] = {}
    given = [(f"--role {text}", text) for text in roles]
    given += [(f"--protect {text}", f"{PROTECTED}={text}") for text in protect]
    for option, text in given:
        role, equals, bodies = (part.strip() for part in text.partition("="))
        if not equals or not role:
            raise RuleError(option, "not a role.", "ROLE=BODIES: --role target=cube")
        if role not in known:
            raise RuleError(
                option, f'no loaded rule has a role "{role}".', ", ".join(sorted(known)),
                did_you_mean(role, known),
            )  # fmt: skip
        bound[role] = (*bound.get(role, ()), *_parts([bodies]))
    return CommandBinding(tuple(codes), tuple(bound.items()))


def _parts(texts: Iterable[str]) -> list[str]:
    return [part.strip() for text in texts for part in text.split(",") if part.strip()]


def _matches(role: str, pattern: str, header: Header, taken: set[str]) -> list[str]:
    """The bodies or joints that a name or a pattern stands for.

    A pattern stands for objects; without any, for fixtures and regions; without any, for joints.
    """
    names = [body.name for body in header.bodies] + [joint.name for joint in header.joints]
    if pattern in names:
        return [pattern]
    if not any(sign in pattern for sign in "*?["):
        raise _no_body(role, pattern, header)
    free = [name for name in names if name not in taken and fnmatchcase(name, pattern)]
    kinds = {body.name: body.kind for body in header.bodies}
    objects = [name for name in free if kinds.get(name) == "object"]
    others = [name for name in free if kinds.get(name) in ("fixture", "region")]
    return objects or others or [name for name in free if name not in kinds]


def _no_body(role: str, pattern: str, header: Header) -> RuleError:
    """The error of a name or pattern that fits no body; objects come first in the list."""
    order = {"object": 0, "fixture": 1, "region": 2, "gripper": 3, "robot": 4}
    bodies = sorted(header.bodies, key=lambda body: order[body.kind])
    names = [body.name for body in bodies] + [joint.name for joint in header.joints]
    return RuleError(
        f"--role {role}={pattern}",
        "the trace has no such body that is free for this role."
        if any(sign in pattern for sign in "*?[")
        else "the trace has no such body.",
        first_few(names, SHOWN),
        did_you_mean(pattern, names),
    )
