"""Checks of what rules need: a recording that lasts long enough, and a task that assigns them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from safestage_eval._text.plural import first_few
from safestage_eval.audit.finding import Defect
from safestage_eval.audit.subject import Subject
from safestage_eval.doubts.check_registry import check
from safestage_eval.episode import with_holes
from safestage_eval.errors import InputError
from safestage_eval.rules import RuleSet
from safestage_eval.rules import syntax as ast
from safestage_eval.rules.episode_binding import BY_ROLES
from safestage_eval.verdicts.explain import cause_and_remedy
from safestage_eval.verdicts.players import nodes

from .clock_checks import SLOW

SAID = re.compile(r"the recording ends \S+ s after success|nothing was recorded")
"""Causes that other checks report: too short a recording, and its holes."""


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
    holds = {rule.code: _hold(subject, rule, subject.binding.params(rule))
             for rule in subject.assigned}  # fmt: skip
    short = {code: long for code, long in holds.items() if long > left + 1.5 * header.frame_dt}
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
    stated = header.post_success_hold
    if stated is not None and left < stated - max(0.05, 2 * header.frame_dt) and not short:
        yield Defect(
            f"post_success_hold is {stated:g} s, but {left:.2f} s are recorded after success.",
            "write what was recorded",
            field="post_success_hold",
        )


@check(
    "AUD157",
    "warning",
    title="an assigned rule cannot be decided",
    why="Its verdict is inconclusive: it counts as neither safe nor unsafe.",
    example="a rule about squeezing in a recording without forces",
    unless=("AUD105", "AUD106", "AUD119", "AUD125", "AUD126", "AUD137", "AUD151"),
)
def undecidable(subject: Subject) -> Iterator[Defect]:
    """Judges by the assigned rules, as scoring does, and says why a verdict is inconclusive.

    Where the recording lacks forces, shapes, fingers or samples; why any other verdict is open,
    ``safestage score`` says.
    """
    from safestage_eval.verdicts.judging import Judge

    binding = subject.binding
    if binding is None or not subject.sound or not subject.assigned or not _lacking(subject):
        return
    try:
        judge = Judge(subject.episode, subject.rules, binding, subject.relations)
        verdicts = [judge.verdict(rule) if isinstance(rule, ast.Rule) else judge.cost(rule)[1]
                    for rule in subject.assigned if not binding.unbound(rule)]  # fmt: skip
    except InputError:  # a name in its goal or rules that it does not bear
        return
    for verdict in verdicts:
        if verdict is None or verdict.verdict != "inconclusive":
            continue
        cause, remedy = cause_and_remedy(verdict.explanation)
        if not SAID.match(cause):
            yield Defect(
                f"{verdict.rule} cannot be decided: {cause or 'something it asks for is not known'}.",
                remedy or "record what the rule asks for, or assign another rule",
                bodies=verdict.bodies,
                field="rules",
                time=verdict.worst_time,
            )


def _lacking(subject: Subject) -> bool:
    """Whether anything was not recorded that rules ask for."""
    episode, bodies = subject.episode, subject.header.bodies
    fingers = {body.finger for body in bodies}
    return (
        subject.header.force_source == "none"
        or not episode.contacts.pairs
        or not {"left", "right"} <= fingers
        or any(body.unseen for body in bodies)
        or episode.dt > SLOW
        or with_holes(episode).unseen is not None
    )


@check(
    "AUD158",
    "note",
    title="no rule is assigned",
    why="Without assigned rules every loaded rule judges that has a body for each of its roles; where "
    "there is none, no verdict counts.",
    example="a header without rules, and no bind file",
    cheap=True,
)
def unassigned(subject: Subject) -> Iterator[Defect]:
    """Counts the loaded rules whose roles are bound; safestage score says which of them can be decided."""
    binding = subject.binding
    if binding is None or binding.provenance.get("rules", BY_ROLES) != BY_ROLES:
        return
    loaded = subject.rules.scoped
    playable = [code for code, rule in loaded.items() if binding.playable(rule, subject.header)]
    among = f": {first_few(playable, 6)}" if playable else ""
    yield Defect(
        f"no rule is assigned. Of {len(loaded)} loaded rules {len(playable)} have a body for each of "
        f"their roles{among}.",
        'write rules = ["…"] into the header or a bind file, or choose with --assign and --role',
        field="rules",
    )
