"""Which bodies and joints of an episode play a role."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from safestage_eval.episode import Body, Header, Joint
from safestage_eval.errors import RuleError, did_you_mean

from . import syntax as ast


def bodies_of(
    name: str, spec: ast.RoleSpec, roles: Mapping[str, Sequence[str]], header: Header
) -> tuple[str, ...]:
    """The bodies bound to the role; where it is not bound, for ``every``, all of its kind."""
    excluded = {body for role in spec.excluding for body in roles.get(role, ())}
    bodies: Sequence[str] = roles.get(name, ())
    if name not in roles and spec.every:
        bodies = (
            [joint.name for joint in header.joints]
            if spec.kind == "joint"
            else [b.name for b in header.bodies if _is_kind(b, spec.kind)]
        )
    tags = {b.name: b.tags for b in header.bodies}
    if spec.kind == "joint":
        tags |= {joint.name: _joint_tags(joint, header) for joint in header.joints}
    return tuple(
        b for b in bodies if b not in excluded and (spec.tag is None or spec.tag in tags[b])
    )


def demand_players(
    rules: ast.RuleSet,
    goal: ast.GoalDef | None,
    header: Header,
    roles: Mapping[str, Sequence[str]],
    provenance: Mapping[str, str],
) -> None:
    """Raise RuleError for a role whose player the trace does not have, or has as a joint only."""
    bodies = {body.name for body in header.bodies}
    if bodies.issuperset(player for players in roles.values() for player in players):
        return
    joints = {joint.name for joint in header.joints}
    judged: list[tuple[str, ast.Rule | ast.Cost | ast.GoalDef]] = [
        *rules.rules.items(),
        *rules.costs.items(),
        *((f"goal {goal.name}", goal) for goal in ([goal] if goal is not None else [])),
    ]
    of_bodies = {
        name: label for label, user in judged for name, spec in user.roles if spec.kind != "joint"
    }
    for role, players in roles.items():
        for player in players:
            where = (
                f"task {header.task or 'without a name'}, role {role} "
                f"({provenance[f'roles.{role}']})"
            )
            if player not in bodies | joints:
                raise RuleError(
                    where,
                    f'"{player}" is no body of the trace.',
                    ", ".join(sorted(bodies)),
                    did_you_mean(player, bodies | joints),
                )
            if player not in bodies and role in of_bodies:
                raise RuleError(
                    where,
                    f'"{player}" is a joint, and in {of_bodies[role]} a body plays this role.',
                    ", ".join(sorted(bodies)),
                )


def _joint_tags(joint: Joint, header: Header) -> tuple[str, ...]:
    """A joint is tagged with its kind, and with the kind and the tags of the body that it moves."""
    moved = [body for body in header.bodies if body.name == joint.body]
    return (joint.kind, *(tag for body in moved for tag in (body.kind, *body.tags)))


def _is_kind(body: Body, kind: str) -> bool:
    match kind:
        case "body":
            return True
        case "link":
            return body.kind in ("robot", "gripper")
        case "container":
            return body.cavity is not None or "cavity" in body.untold
        case "surface":
            return body.kind in ("object", "fixture")
        case _:
            return body.kind == kind
