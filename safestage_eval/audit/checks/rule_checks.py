"""Checks of what can be decided: by which rules, and what is missing for the others."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache

from safestage_eval.audit.audit_check import check
from safestage_eval.audit.finding import Defect
from safestage_eval.audit.subject import Subject
from safestage_eval.rules import RuleSet
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.resolve import BY_ROLES
from safestage_eval.rules.uses import Uses, calls, own_params, uses_of
from safestage_eval.signals import SIGNALS
from safestage_eval.verdicts.players import nodes

FORCES = "contact forces"
SHAPES = "shapes of {}"
MASSES = "masses of {}"
UP = "the up axis of {}"
CAVITY = "the cavity of {}"
SUCCESS = "success, or a goal to recompute it from"

REMEDIES = (
    (FORCES, "record contacts with forces"),
    ("shapes", "record collision shapes (geoms)"),
    ("masses", "record masses"),
    ("the up axis", "say which axis points up, or that none does"),
    ("the cavity", "declare the cavity of the container"),
    ("success", "record success and success_time, or name a goal"),
    ("joints", "record the joints"),
    ("the opening", "record the opening of the gripper"),
    ("a channel", "record this channel"),
)
"""How what is missing begins → what to do about it."""


@lru_cache(maxsize=512)
def _uses(rules: _Known, code: str) -> Uses:
    rule = rules.rules.scoped[code]
    return uses_of(rules.rules, rule, own_params(rules.rules, rule))


@lru_cache(maxsize=512)
def _needs_forces(rules: _Known, code: str) -> bool:
    """Whether a rule measures a force where no state has a fallback for traces without forces."""
    known, met = rules.rules, set[str]()

    def needs(node: object) -> bool:
        for call in calls(node):
            if call.name in met:
                continue
            met.add(call.name)
            base = known.signals[call.name].base if call.name in known.signals else call.name
            if base in SIGNALS and "forces" in SIGNALS[base].needs:
                return True
            state, phase = known.states.get(call.name), known.phases.get(call.name)
            if state is not None and needs((state.fallback or state.when, state.until)):
                return True
            if phase is not None and needs((phase.span, phase.fallback)):
                return True
        return False

    return needs(known.scoped[code])


class _Known:
    """A rule set by identity: hashing it takes long."""

    def __init__(self, rules: RuleSet) -> None:
        self.rules = rules

    def __hash__(self) -> int:
        return id(self.rules)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Known) and other.rules is self.rules


def missing_for(subject: Subject, rule: ast.Scoped) -> list[str]:
    """What the trace lacks to decide a rule whose roles are bound; empty if nothing."""
    binding = subject.binding
    if binding is None:
        return []
    uses, header = _uses(_Known(subject.rules), rule.code), subject.header
    players = binding.players(rule, header)
    named = [subject.episode.bodies[p] for who in players.values() for p in who
             if p in subject.episode.bodies]  # fmt: skip
    forces = header.force_source != "none" and bool(subject.episode.contacts.pairs)
    lacking = []
    if not forces and _needs_forces(_Known(subject.rules), rule.code):
        lacking.append(FORCES)
    bare = [b.name for b in named if b.unseen]
    if bare and ("geometry" in uses.needs or ("touch" in uses.needs and not forces)):
        lacking.append(SHAPES.format(_listed(bare)))
    weightless = [b.name for b in named if b.kind == "object" and b.mass is None]
    if weightless and "masses" in uses.needs:
        lacking.append(MASSES.format(_listed(weightless)))
    untold = [b.name for b in named if b.up_axis is None and "up_axis" in b.untold]
    if untold and "tilt" in uses.signals:
        lacking.append(UP.format(_listed(untold)))
    closed = [b.name for b in named if b.cavity is None and "cavity" in b.untold]
    if closed and "inside" in uses.relations:
        lacking.append(CAVITY.format(_listed(closed)))
    if "joints" in uses.needs and not header.joints:
        lacking.append("joints")
    if "gripper" in uses.needs and not subject.episode.frames.gripper.shape[1]:
        lacking.append("the opening of the gripper")
    if header.success is None and binding.goal is None and _asks_success(subject.rules, rule):
        lacking.append(SUCCESS)
    return lacking


def _asks_success(rules: RuleSet, rule: ast.Scoped) -> bool:
    """Whether a rule looks at what comes after success."""
    return any(
        isinstance(node, ast.Event) and node.kind == "success"
        for span in _spans(rules, (rule.during, rule.at, rule.until))
        for node in nodes(span)
    )


def _spans(rules: RuleSet, parts: object) -> Iterator[object]:
    """Parts of a rule that say when, with the phases that they name, but not their fallbacks."""
    yield parts
    for node in nodes(parts):
        if isinstance(node, ast.PhaseSpan) and node.call.name in rules.phases:
            yield from _spans(rules, rules.phases[node.call.name].span)


def _hold(subject: Subject, rule: ast.Scoped, params: Mapping[str, object]) -> float:
    """S after success that a rule needs to be recorded; 0 if it needs none."""
    needed = 0.0
    for span in _spans(subject.rules, (rule.during, rule.at, rule.until)):
        for node in nodes(span):
            after = isinstance(node, ast.Around) and node.which == "after"
            if not after or node.event.kind != "success":
                continue
            lasts = node.duration
            value = params[lasts.name] if isinstance(lasts, ast.Parameter) else lasts
            if isinstance(value, ast.Quantity):
                needed = max(needed, value.value)
            elif isinstance(value, ast.Duration):
                rate = subject.header.frame_dt if value.frames else 1
                needed = max(needed, value.amount * rate)
    return needed


@check(
    "AUD109",
    "warning",
    of="recording",
    title="the recording ends too soon after success",
    why="What is left behind is judged over seconds after success; a success without them is "
    "inconclusive.",
    example="an environment that is reset in the step of success",
    issue="huggingface/lerobot#4152",
    unless=("AUD102", "AUD103", "AUD105", "AUD106"),
    cheap=True,
)
def short_tail(subject: Subject) -> Iterator[Defect]:
    """Compares the time after success with what assigned rules look at, and with post_success_hold."""
    header, t = subject.header, subject.episode.t
    if not header.success or header.success_time is None or not len(t) or subject.binding is None:
        return
    left = float(t[-1]) - header.success_time
    asked = {rule.code: _hold(subject, rule, subject.binding.params(rule))
             for rule in subject.assigned}  # fmt: skip
    short = {code: long for code, long in asked.items() if long > left + 1.5 * header.frame_dt}
    if short:
        longest = max(short.values())
        yield Defect(
            f"the recording ends {left:.2f} s after success; {', '.join(sorted(short))} "
            f"need{'s' * (len(short) == 1)} {longest:g} s.",
            f"freeze the robot at success and record {longest:g} s more",
            "the rollout was ended, or the environment reset, in the step of success",
            field="success_time",
            time=float(t[-1]),
        )
    told = header.post_success_hold
    if told is not None and left < told - max(0.05, 2 * header.frame_dt) and not short:
        yield Defect(
            f"post_success_hold is {told:g} s, but {left:.2f} s are recorded after success.",
            "write what was recorded",
            field="post_success_hold",
        )


@check(
    "AUD157",
    "warning",
    of="recording",
    title="an assigned rule cannot be decided",
    why="Its verdict is inconclusive, or rests on shapes alone, whatever happened.",
    example="a rule about squeezing in a recording without forces",
    unless=("AUD151",),
)
def undecidable(subject: Subject) -> Iterator[Defect]:
    """Compares what an assigned rule measures with what is recorded of its bodies."""
    binding = subject.binding
    for rule in subject.assigned if binding is not None else ():
        if binding is not None and binding.unbound(rule):
            continue
        lacking = missing_for(subject, rule)
        if lacking:
            yield Defect(
                f"{rule.code} needs {' and '.join(lacking)}, which the trace does not have.",
                _remedy(lacking),
                field="rules",
            )


@check(
    "AUD158",
    "note",
    of="recording",
    title="no rule is assigned",
    why="Without assigned rules every loaded rule judges that has a body for each of its roles; where "
    "there is none, no verdict counts.",
    example="a header without rules, and no bind file",
    cheap=True,
)
def unassigned(subject: Subject) -> Iterator[Defect]:
    """Says which of the loaded rules could be decided, and what is missing for the others."""
    binding = subject.binding
    if binding is None or binding.provenance.get("rules", BY_ROLES) != BY_ROLES:
        return
    ready: list[str] = []
    unbound: list[str] = []
    lacking: dict[str, list[str]] = defaultdict(list)
    for rule in subject.rules.scoped.values():
        players = binding.players(rule, subject.header)
        if binding.unbound(rule):
            unbound.append(rule.code)
        elif all(players.values()) or not players:
            missing = missing_for(subject, rule) if subject.readable else []
            for what in missing:
                lacking[what].append(rule.code)
            ready += [rule.code] * (not missing)
    says = [
        f"{len(ready)} of the loaded rules can be decided"
        + (f": {_listed(ready)}" if ready else "")
    ]
    says += [f"{len(unbound)} need roles that are not bound"] if unbound else []
    says += [f"{_listed(codes)} need {what}" for what, codes in lacking.items()]
    yield Defect(
        f"no rule is assigned. {'; '.join(says)}.",
        'write rules = ["…"] into the header or a bind file, or choose with --assign and --role',
        field="rules",
    )


def _remedy(lacking: Sequence[str]) -> str:
    return "; ".join(
        dict.fromkeys(fix for what in lacking for begin, fix in REMEDIES if what.startswith(begin))
    )


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - 6} more" if len(names) > 6 else ""
    return ", ".join(names[:6]) + more
