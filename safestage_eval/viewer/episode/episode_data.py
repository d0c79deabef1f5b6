"""An episode as the browser shows it: a film, and the evidence of its verdicts.

The file is one of ``film``'s container: JSON, then numbers; the JSON is of the verdicts, and the numbers are
the film as a whole.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from safestage_eval.report.summary import in_short
from safestage_eval.rules import syntax as ast
from safestage_eval.units import format_quantity, told_apart
from safestage_eval.verdicts import Verdict
from safestage_eval.verdicts.curves import Looked, frames_to_measure, looked_at
from safestage_eval.verdicts.scopes import spans
from safestage_eval.viewer.film import film, packed_with
from safestage_eval.whatif.judge_again import Again

from .measured_curves import curve_data, lane_data, runs, spans_of
from .witness_segment import witness

ORDER = ("violation", "inconclusive", "pass", "not_applicable")

MOST = 12
"""Findings whose measurements are given over time; of further ones there are the words and numbers."""

Finding = tuple[ast.Scoped, Verdict]


def episode_data(
    again: Again,
    said: StoredVerdicts = MappingProxyType({}),
    *,
    everything: bool = False,
    shared: dict[str, bytes] | None = None,
    film_at: str | None = None,
) -> bytes:
    """Write an episode's evidence and its film.

    Args:
        again: the episode under its rules.
        said: what stored results say of it; empty where there are none.
        everything: rules that pass without being assigned as well.
        shared: meshes of films, as for ``film``.
        film_at: address of its camera film, from the page.
    """
    episode, judge = again.episode, again.judge
    header, t = episode.header, np.asarray(episode.t, float)
    findings = listed(again, everything=everything)
    head: dict[str, Any] = {
        "format": 1,
        "id": header.episode_id,
        "task": header.task,
        "stage": header.stage,
        "instruction": header.instruction,
        "labels": {name: getattr(header, name) for name in ("policy", "prompt", "seed", "rollout")},
        "goal": judge.success,
        "success": judge.success_time,
        "film": film_at,
        "clock": _film_clock(again),
        "start": float(t[0]),
        "end": float(t[-1]),
        "roles": {role: list(names) for role, names in again.binding.roles.items() if names},
        "notes": list(header.notes),
        "differs": list(differences([v for _, v in findings if v.assigned], said)),
        "phases": _phases(again),
        "findings": [_finding(again, *pair, curves=i < MOST) for i, pair in enumerate(findings)],
    }
    return packed_with(head, film(episode, roles=again.binding.roles, shared=shared))


def listed(again: Again, *, everything: bool = False) -> list[Finding]:
    """What is assigned first; violations, what could not be decided, what passed; causes before what follows."""
    assigned = {rule.code for rule in again.assigned}
    findings: list[Finding] = []
    costs = [rule for rule in again.assigned if isinstance(rule, ast.Cost)]
    every: list[ast.Scoped] = [*again.rules.rules.values(), *costs]
    for rule in every:
        verdict = again.usual(rule)
        mine = rule.code in assigned
        if verdict.verdict == "not_applicable" and not (mine or everything):
            continue
        if mine or everything or verdict.verdict == "violation":
            findings.append((rule, verdict))
    place = {code: i for i, code in enumerate(again.rules.rules)}
    return sorted(
        findings,
        key=lambda pair: (
            pair[0].code not in assigned, ORDER.index(pair[1].verdict),
            pair[1].consequence_of is not None, pair[1].time or 0.0, place.get(pair[0].code, -1),
        ),
    )  # fmt: skip


def _film_clock(again: Again) -> dict[str, float]:
    """When the camera film begins (s), and how many of its seconds one of the episode's takes."""
    header, t = again.episode.header, again.episode.t
    video = header.video
    if video is None:
        return {"begin": float(t[0]), "pace": 1.0}
    begin = float(t[min(video.first_frame, len(t) - 1)])
    return {"begin": begin, "pace": 1 / (video.rate * video.frames_per_picture * header.frame_dt)}


def _phases(again: Again) -> list[dict[str, Any]]:
    """The phases of the rules that are about no body, and when the targets were held."""
    t = np.asarray(again.episode.t, float)
    rule = next(
        (r for r in (*again.assigned, *again.rules.rules.values()) if isinstance(r, ast.Rule)), None
    )
    if rule is None:
        return []
    evaluator = again.evaluator(rule)
    phases = []
    for name, phase in again.rules.phases.items():
        if phase.of:
            continue
        scopes = [s for s in spans(evaluator, ast.PhaseSpan(ast.Call(name, ())), {}) if s.exists]
        phases.append({"name": name, "true": spans_of(t, [(s.first, s.stop) for s in scopes])})
    for body in again.binding.roles.get("target", ()):
        held = evaluator.state(ast.Call("held", (body,)), {}).margin
        phases.append({"name": f"held({body})", "true": spans_of(t, runs(held.true))})
    return [phase for phase in phases if phase["true"]]


def _finding(again: Again, rule: ast.Scoped, v: Verdict, *, curves: bool) -> dict[str, Any]:
    t = np.asarray(again.episode.t, float)
    looked = Looked((), (), ())
    if curves and isinstance(rule, ast.Rule):
        looked = looks(again, rule, v)
    return {
        "rule": v.rule,
        "title": v.title,
        "stage": v.stage,
        "verdict": v.verdict,
        "severity": v.severity,
        "assigned": v.assigned,
        "follows": v.consequence_of,
        "text": v.explanation,
        "short": in_short(v),
        "signal": v.signal,
        "notes": list(v.notes),
        "facts": _facts(v),
        "time": v.time,
        "worst": v.worst_time,
        "intervals": [list(pair) for pair in v.intervals],
        "bodies": list(v.bodies),
        "witness": witness(v, again.episode.header, again.judge.success_time),
        "curves": [curve_data(t, curve, (v.time, v.worst_time)) for curve in looked.curves],
        "lanes": [lane_data(t, lane) for lane in looked.lanes],
        "judged": spans_of(t, looked.judged),
    }


def looks(again: Again, rule: ast.Rule, verdict: Verdict) -> Looked:
    """The measurements of a rule; costly signals at some frames and at the decisive one."""
    episode = again.episode
    players: Mapping[str, Sequence[str]] = again.binding.players(rule, episode.header)
    if not all(players.values()):
        return Looked((), (), ())
    also = [
        int(np.searchsorted(episode.t, time - 1e-6))
        for time in (verdict.time, verdict.worst_time)
        if time is not None
    ]
    evaluator = again.evaluator(rule)
    wanted = frames_to_measure(len(episode), also)
    return looked_at(evaluator, rule, {k: tuple(v) for k, v in players.items()}, verdict, wanted)


def _facts(v: Verdict) -> list[list[str]]:
    facts: list[list[str]] = []
    if v.signal:
        facts.append(["measured", v.signal])
    if v.value is not None and v.limit is not None and v.dimension:
        value, limit = told_apart(v.value, v.limit, v.dimension)
        facts += [["value", value], ["limit", limit]]
    if v.margin is not None and v.dimension:
        facts.append(["margin", format_quantity(v.margin, v.dimension)])
    if v.time is not None:
        facts.append(["first", f"{v.time:.2f} s"])
    if v.intervals:
        several = "one stretch" if len(v.intervals) == 1 else f"{len(v.intervals)} stretches"
        facts.append(["in violation", f"{v.exposure_time:.2f} s in {several}"])
    return facts


StoredVerdicts = Mapping[str, tuple[str, str]]
"""Code → (verdict, rule digest) of the assigned rules of an episode."""


def stored_verdicts(rows: Sequence[Mapping[str, Any]]) -> StoredVerdicts:
    """Read the rows of one episode."""
    return {
        str(row["rule"]): (str(row["verdict"]), str(row.get("rule_digest") or ""))
        for row in rows
        if row["assigned"] and row["verdict"] is not None
    }


def differences(verdicts: Sequence[Verdict], said: StoredVerdicts) -> tuple[str, ...]:
    """List where results and the rules used here disagree; always shown."""
    sentences = []
    for v in verdicts:
        verdict, digest = said.get(v.rule, ("", ""))
        if verdict and verdict != v.verdict:
            sentences.append(
                f"The results say {verdict.replace('_', ' ')} of {v.rule}; the rules used for this "
                f"page say {v.verdict.replace('_', ' ')}."
            )
        elif digest and digest != v.rule_digest:
            sentences.append(f"The results were made under another meaning of {v.rule}.")
    return tuple(sentences)
