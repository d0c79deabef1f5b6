"""Checks of names: roles, materials, tags, rules, parameters and goals that mean something."""

from __future__ import annotations

from collections.abc import Iterator

from safestage_eval.audit.finding import Defect
from safestage_eval.audit.subject import Subject
from safestage_eval.doubts.check_registry import check
from safestage_eval.errors import nearest

TAGS = frozenset(
    ["fragile", "sharp", "heavy", "hot", "liquid", "electronics", "container", "food", "tool"]
)
"""Tags that rules ask for, or that are usual."""


def _meant(near: str) -> str:
    return f'a misspelling of "{near}"' if near else ""


@check(
    "AUD151",
    "error",
    title="a role names no body",
    why="Nothing is judged of an episode whose roles are bound to bodies that are not there.",
    example='target = ["botle"] in a scene with a bottle',
    cheap=True,
)
def role_players(subject: Subject) -> Iterator[Defect]:
    """Binds roles to bodies and joints as scoring does, by header and bind file."""
    error = subject.unbound
    if error is not None:
        fix = error.fix or f"allowed: {error.allowed}"
        yield Defect(f"{error.where}: {error.what}", fix, field="roles")


@check(
    "AUD152",
    "error",
    title="a role that a rule asks for is not bound",
    why="An assigned rule is inconclusive: nobody says which bodies it is about. Of a role that is "
    "misspelt, the rules that are not assigned judge nothing either.",
    example='rules = ["ETS101"], and roles = { target, protcted }',
    unless=("AUD151",),
    cheap=True,
)
def unbound_roles(subject: Subject) -> Iterator[Defect]:
    """Compares the roles of assigned rules with those that header and bind file bind.

    Where no rule is assigned, a warning of roles that no loaded rule asks for and that are spelt
    nearly as one that a rule does.
    """
    binding = subject.binding
    if binding is not None and not subject.assigned:
        unbound = {role for rule in subject.rules.scoped.values() for role in binding.unbound(rule)}
        for role in sorted(unbound):
            near = binding.misnamed(role)
            if near:
                yield Defect(
                    f"no loaded rule asks for the role {near}, and nothing binds {role}.",
                    f"rename roles.{near} to roles.{role}",
                    f'"{near}" is a misspelling of "{role}"',
                    field=f"roles.{near}",
                    severity="warning",
                )
    for rule in subject.assigned if binding is not None else ():
        for role in binding.unbound(rule) if binding is not None else ():
            near = binding.misnamed(role) if binding is not None else ""
            yield Defect(
                f"{rule.code} is assigned, but nothing binds its role {role}.",
                f"rename roles.{near} to roles.{role}"
                if near
                else f'add roles.{role} = ["…"] to the header or a --bind file; [] for none',
                f'"{near}" is a misspelling of "{role}"' if near else "",
                field=f"roles.{near or role}",
            )


@check(
    "AUD153",
    "warning",
    title="a material that is probably misspelt",
    why="Its limits for tilt, fall and squeeze are those of the default row.",
    example='material = "galss"',
    cheap=True,
)
def materials(subject: Subject) -> Iterator[Defect]:
    """Looks materials up among those of the loaded rules; only near misses are reported."""
    known = {*subject.rules.materials} - {"default"}
    for body in subject.header.bodies:
        name = body.material
        near = "" if name is None or name in known else nearest(name, known, 0.75)
        if near:
            yield Defect(
                f'{body.name!r} is of "{name}", a material without a row in the loaded rules.',
                f'write material = "{near}"',
                _meant(near),
                bodies=(body.name,),
                field="bodies.material",
            )


@check(
    "AUD154",
    "warning",
    title="a tag that is probably misspelt",
    why='Rules about "every object tagged …" leave the body out.',
    example='tags = ["fragil"]',
    cheap=True,
)
def tags(subject: Subject) -> Iterator[Defect]:
    """Compares tags with those that rules ask for and with usual ones; only near misses are reported."""
    required = {spec.tag for rule in subject.rules.scoped.values() for _, spec in rule.roles}
    known = {*TAGS, *(tag for tag in required if tag)}
    for body in subject.header.bodies:
        for tag in body.tags:
            near = "" if tag in known else nearest(tag, known, 0.8)
            if near:
                yield Defect(
                    f'{body.name!r} is tagged "{tag}", which no rule asks for.',
                    f'write "{near}"',
                    _meant(near),
                    bodies=(body.name,),
                    field="bodies.tags",
                )


@check(
    "AUD155",
    "error",
    title="an assigned rule that does not exist",
    why="Nothing is judged by it, and the episode is not in any rate of its stage.",
    example='rules = ["FSH110"]',
    cheap=True,
)
def unknown_rules(subject: Subject) -> Iterator[Defect]:
    """Looks the assigned codes up among the loaded rules."""
    known = subject.rules.scoped
    codes = subject.binding.assigned if subject.binding else subject.header.rules
    for code in codes:
        if code in known:
            continue
        near = nearest(code, known, 0.7)
        yield Defect(
            f"{code} is assigned, but no loaded rule file has it.",
            f"write {near}, or load the file that has {code} with --rules"
            if near
            else f"load the file that has {code} with --rules",
            f"a misspelling of {near}: {known[near].title}" if near else "its file is not loaded",
            field="rules",
        )


@check(
    "AUD156",
    "warning",
    title="a parameter or goal that does not exist",
    why="The value that the task asks for is not used; success is not recomputed.",
    example='parameters = { min_clearence = "12 cm" }',
    cheap=True,
)
def parameters(subject: Subject) -> Iterator[Defect]:
    """Looks parameters and the goal up in the loaded rules; only near misses of parameters count."""
    for name in subject.header.parameters:
        near = "" if name in subject.rules.params else nearest(name, subject.rules.params, 0.8)
        if near:
            yield Defect(
                f'no loaded rule file has a parameter "{name}".',
                f'write parameters.{near} = "…"',
                _meant(near),
                field=f"parameters.{name}",
            )
    goal = subject.header.goal
    if isinstance(goal, str) and goal not in subject.rules.goals:
        near = nearest(goal, subject.rules.goals)
        yield Defect(
            f'no loaded rule file has a goal "{goal}": success is not recomputed.',
            f'write goal = "{near}"' if near else "load the file that declares it with --rules",
            _meant(near),
            field="goal",
            severity=None if near else "note",
        )
