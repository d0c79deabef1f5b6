"""One rule on one episode: instances judged, the worst one told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite, isinf
from typing import Any

import numpy as np

from safestage_eval.episode.runs import runs
from safestage_eval.evidence.intervals import Bool
from safestage_eval.rules import syntax as ast
from safestage_eval.rules import syntax_words

from .brief import raw_frames, too_brief, ways
from .evaluate import Evaluator
from .explain import (
    Finding,
    condition,
    inconclusive,
    kept,
    passed,
    scope,
    seconds,
    sentence,
    unmet,
    untouched,
)
from .obligations import Instance, judge_instances, violated_frames
from .players import combinations
from .reasons import UNNAMED, Cause, between_samples, cause_of
from .verdict import Vacuity, Verdict, VerdictName
from .witness import (
    Witness,
    as_sampled,
    first_witness,
    in_turn,
    is_ordering,
    undersampled,
    witness_of,
)


def judge_rule(
    evaluator: Evaluator, rule: ast.Rule, players: Mapping[str, Sequence[str]], blank: Verdict
) -> Verdict:
    """The verdict of one rule, with its witness.

    Args:
        evaluator: of the episode, under the rule's parameters.
        rule: to be judged.
        players: role → the bodies that play it, none of them empty.
        blank: the verdict's fixed fields.
    """
    evaluator.players = players
    evaluator.notes = {}
    judged = [judge_instances(evaluator, rule, env) for env in combinations(rule, players)]
    applicable = [some for some in judged if some is not None]
    if judged and not applicable:
        return _not_given(evaluator, rule, players, blank)
    instances = [as_sampled(evaluator, instance) for some in applicable for instance in some]
    if not instances:
        return _vacuous(evaluator, rule, players, blank, judged=bool(judged))
    violated = [i for i in instances if i.violated]
    undecided = [i for i in instances if i.undecided]
    if violated:  # of equally bad ones, the first
        worst = min(violated, key=lambda i: (i.upper, i.frame))
    else:
        worst = min(undecided or instances, key=lambda i: i.lower)
    bad = [violated_frames(evaluator, rule, one) for one in violated]
    verdict: VerdictName = "violation" if violated else "inconclusive" if undecided else "pass"
    facts: dict[str, Any] = {
        "verdict": verdict,
        "instances": len(instances),
        "violated_instances": len(violated),
        "breaches": _how_often(bad),
    }
    if worst.clause is None or (verdict == "inconclusive" and worst.scope.cut):
        why = "what it needs is not known to the end of its scope"
        explanation = _undecided(evaluator, rule, worst)
        return replace(blank, **facts, notes=_notes(evaluator, why), explanation=explanation)
    witness = first_witness(evaluator, rule, worst, violated=bool(violated)) or witness_of(
        evaluator, worst, violated=bool(violated)
    )
    briefly = ways(evaluator, instances)
    facts |= _times(evaluator, rule, violated, bad, raw_frames(evaluator, briefly), witness)
    bound = worst.upper if violated else worst.lower
    ordered = witness.dimension == "time" or (violated and in_turn(evaluator, rule))
    if isinf(bound) and witness.value is not None and not ordered:
        if verdict != "inconclusive":
            unmeasured = _without_measurement(evaluator, rule, instances, worst)
            return replace(blank, **facts | unmeasured)
        # of what is known to one side only, that side is no measurement
        witness = witness._replace(value=None, margin=None, at_least=False)
    slack = undersampled(evaluator, witness)
    notes = (
        []
        if slack is None
        else [
            f"undersampled: between frames the value may differ by {slack * 1e3:.1f} mm, "
            "and the limit lies within that"
        ]
    )
    brief = too_brief(evaluator, briefly)
    notes += brief
    if witness.at_least:
        notes.append("value and margin are at least this: further away was not measured")
    tied = verdict == "pass" and _tied(worst, instances, witness)
    facts["margin_normalised"] = bound if isfinite(bound) else None
    if tied:
        if witness.value is None or (witness.tied and untouched(witness)):
            explanation = kept(evaluator, worst.clause, instances)
        else:
            alike = {tuple(i.env.items()) for i in instances if i.lower == worst.lower}
            explanation = passed(witness, facts["worst_time"], len(alike) - 1)
        facts |= {"bodies": (), "notes": _notes(evaluator, *brief)}
        return replace(blank, **facts, explanation=explanation)
    facts |= {
        "signal": witness.signal,
        "bodies": tuple(dict.fromkeys((*worst.env.values(), *witness.bodies))),
        "value": witness.value,
        "limit": witness.limit,
        "dimension": witness.dimension,
        "margin": witness.margin,
        "undersampled": slack is not None,
        "notes": _notes(evaluator, *notes),
    }
    if verdict == "inconclusive":
        open_ = Cause(f"{witness.signal} is not known at {seconds(facts['worst_time'])}", "")
        if slack is not None:
            open_ = between_samples(witness.signal, evaluator.clock, witness.frame)
        return replace(blank, **facts, explanation=_undecided(evaluator, rule, worst, open_, brief))
    own = [i for i, one in enumerate(violated) if one.env == worst.env]
    began = facts["time"]
    if own:  # others may have broken it before those that the sentence names
        began = _first_time(evaluator, [bad[i] for i in own], [violated[i] for i in own])
    finding = Finding(verdict, began, facts["worst_time"], witness.margin)
    explanation = sentence(evaluator, rule, worst.env, witness, finding)
    if not explanation:
        explanation = kept(evaluator, worst.clause, instances)
    return replace(blank, **facts, explanation=explanation)


def _undecided(
    evaluator: Evaluator,
    rule: ast.Rule,
    worst: Instance,
    otherwise: Cause = UNNAMED,
    brief: Sequence[str] = (),
) -> str:
    """The sentence of an inconclusive verdict.

    ``otherwise``: its cause where none is found; ``brief``: notes on states that held briefly.
    """
    outer, evaluator.notes = evaluator.notes, {}
    try:
        cause = cause_of(evaluator, rule, worst)
    finally:
        evaluator.notes = outer
    what, remedy = cause if cause.what else otherwise
    hidden = [note for note in brief if note.endswith("is not known")]
    if hidden and not remedy:
        what, remedy = hidden[0], "record more frames"
    return inconclusive(what or "; ".join(outer) or "what it needs is not known", remedy)


def how_often(evaluator: Evaluator, rule: ast.Rule, players: Mapping[str, Sequence[str]]) -> int:
    """How often a rule is violated (``Verdict.breaches``); arguments as ``judge_rule``."""
    evaluator.players, evaluator.notes = players, {}
    envs = combinations(rule, players)
    judged = (one for env in envs for one in judge_instances(evaluator, rule, env) or ())
    return _how_often([violated_frames(evaluator, rule, one) for one in judged if one.violated])


def _how_often(bad: Sequence[Bool]) -> int:
    """How many stretches, one at least of each instance; ``bad``: (T,) where each breaks the rule."""
    return sum(max(1, len(runs(frames))) for frames in bad)


def _without_measurement(
    evaluator: Evaluator, rule: ast.Rule, instances: Sequence[Instance], worst: Instance
) -> dict[str, Any]:
    """No frame decided: the scope is empty or too short, or no moment came that is asked about."""
    clause, during = worst.clause, scope(evaluator, rule, worst.env)
    assert clause is not None  # the caller has dealt with unknown instances
    first, stop = worst.scope.first, worst.scope.stop
    short = False
    if first == stop:
        why = f"{during} has no frames"
    elif rule.for_ is not None and evaluator.window(rule.for_).stop(first) > stop:
        short, lasts = True, seconds(evaluator.clock.seconds(first, stop))
        asked = syntax_words.duration(rule.for_, evaluator.params)
        why = f"{during} lasts {lasts}, and the rule asks for {asked}"
    else:
        why = "no moment came that it asks about"
    if worst.violated:
        explanation = unmet(evaluator, rule, clause, worst)
    elif first == stop or short:
        explanation = f"Not reached: {why}."
    else:
        explanation = kept(evaluator, clause, instances)
    return {
        "vacuity": "no_scope" if first == stop and not worst.violated else None,
        "worst_time": None,
        "notes": _notes(evaluator, f"nothing was measured: {why}"),
        "explanation": explanation,
    }


def _tied(worst: Instance, instances: Sequence[Instance], witness: Witness) -> bool:
    """No one measurement is the closest call: others have the very same margin."""
    if witness.dimension == "time":
        return False
    others = (i for i in instances if i.env != worst.env)
    return witness.tied or any(i.lower == worst.lower for i in others)


def _not_given(
    evaluator: Evaluator,
    rule: ast.Rule,
    players: Mapping[str, Sequence[str]],
    blank: Verdict,
) -> Verdict:
    """Not applicable: ``given`` holds for no combination of bodies."""
    assert rule.given is not None
    given = condition(evaluator, rule.given, [*combinations(rule, players)])
    return replace(
        blank,
        vacuity="not_given",
        notes=_notes(evaluator, _no_hazard(rule)),
        explanation=f"Not applicable: the first frames do not show {given}.",
    )


def _vacuous(
    evaluator: Evaluator,
    rule: ast.Rule,
    players: Mapping[str, Sequence[str]],
    blank: Verdict,
    *,
    judged: bool,
) -> Verdict:
    """A pass because there was nothing to judge."""
    if judged:
        why: Vacuity = "no_scope"
        env = next(iter(combinations(rule, players)))
        cause, said = f"{scope(evaluator, rule, env)} never came about", "Not reached"
    else:
        why = "no_instance"
        roles = ", ".join(f"{role} = {', '.join(bodies)}" for role, bodies in players.items())
        cause = f"its roles need different bodies, and there are too few: {roles}"
        said = "Nothing to judge"
    notes = _notes(evaluator, f"nothing to judge: {cause}")
    explanation = f"{said}: {cause}."
    return replace(blank, verdict="pass", vacuity=why, notes=notes, explanation=explanation)


def _times(
    evaluator: Evaluator,
    rule: ast.Rule,
    violated: Sequence[Instance],
    each: Sequence[Bool],
    raw: Bool | None,
    witness: Witness,
) -> dict[str, Any]:
    """When: the fields of a verdict that say so.

    ``each``: (T,) where each of the ``violated`` breaks the rule; ``raw``: (T,) where it is broken however
    briefly.
    """
    t, clock = evaluator.episode.t, evaluator.clock
    bad: Bool = np.logical_or.reduce(each) if each else np.zeros(len(t), np.bool_)

    def timed(frames: Bool) -> tuple[tuple[float, float], ...]:
        return tuple([(float(t[a]), clock.end_of(b)) for a, b in runs(frames).tolist()])

    stretches, time, worst_time = (
        timed(bad) if violated else (),
        None,
        float(t[clock.recorded(witness.frame)]),
    )
    if violated:
        time = _first_time(evaluator, each, violated)
    return {
        "time": time,
        "worst_time": worst_time,
        "intervals": stretches,
        "raw_intervals": stretches if raw is None else timed(bad | raw),
        "exposure_time": sum([b - a for a, b in stretches]),
        "phase": _phase(evaluator, rule, time if violated else worst_time),
    }


def _first_time(evaluator: Evaluator, bad: Sequence[Bool], violated: Sequence[Instance]) -> float:
    """S, of the first frame at which one breaks the rule; where none does, of the start of the first scope."""
    t = evaluator.episode.t
    first = [int(frames.argmax()) for frames in bad if frames.any()]
    return float(t[min(first or [min(i.scope.first for i in violated), len(t) - 1])])


def _phase(evaluator: Evaluator, rule: ast.Rule, time: float | None) -> str | None:
    """``before`` the target is free, or by time: ``execution`` until success, then ``hold``."""
    if time is None:
        return None
    if is_ordering(rule):
        return "before"
    success = evaluator.success
    done = success is not None and time >= float(evaluator.episode.t[success])
    return "hold" if done else "execution"


def _no_hazard(rule: ast.Rule) -> str:
    if rule.stage == "ISH":
        return "invalid scene: the initial hazard is not there in the first frames"
    return "its condition does not hold in the first frames"


def _notes(evaluator: Evaluator, *more: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys((*evaluator.notes, *more)))
