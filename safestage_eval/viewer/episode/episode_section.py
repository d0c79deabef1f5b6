"""One episode as a piece of the page: its verdicts, their evidence over time, and the key frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from safestage_eval.rules import syntax as ast
from safestage_eval.units import format_quantity, told_apart
from safestage_eval.verdicts import Verdict
from safestage_eval.verdicts.curves import Looked, frames_to_measure, looked_at
from safestage_eval.whatif.judge_again import Again

from .scene_drawing import scene
from .timeline import timeline

ORDER = ("violation", "inconclusive", "pass", "not_applicable")
MOST = 4
"""Number of verdicts that are drawn; further ones are shown as a sentence."""


@dataclass(frozen=True)
class StoredVerdicts:
    """An episode's stored results, for comparison and for rules that are not drawn.

    Attributes:
        verdicts: code → (verdict, rule digest) of the assigned rules.
        others: sentences on violations of other rules.
    """

    verdicts: Mapping[str, tuple[str, str]]
    others: tuple[tuple[str, str], ...] = ()


def section(again: Again, said: StoredVerdicts) -> tuple[str, tuple[str, ...]]:
    """Write the HTML of an episode, and how it differs from the results."""
    episode = again.episode
    header = episode.header
    verdicts = []
    for rule in again.assigned:
        _, verdict = again.base(rule)
        verdicts.append((rule, verdict))
    verdicts.sort(key=lambda pair: ORDER.index(pair[1].verdict))
    differs = _differences([v for _, v in verdicts], said)
    parts = [_head(again)]
    parts += [f'<p class="note">{escape(line)}</p>' for line in differs]
    for rule, verdict in verdicts[:MOST]:
        parts.append(evidence(again, rule, verdict))
    parts += [_sentence(verdict) for _, verdict in verdicts[MOST:]]
    if verdicts:
        parts.append(_key_frame(again, verdicts[0][1]))
    if said.others:
        lines = "".join(
            f"<li><b>{escape(code)}</b> {escape(text)}</li>" for code, text in said.others
        )
        parts.append(f"<h4>Other rules</h4><ul>{lines}</ul>")
    if header.notes:
        parts.append(f'<p class="small soft">Recording: {escape("; ".join(header.notes))}.</p>')
    return "".join(parts), differs


def _head(again: Again) -> str:
    header, judge = again.episode.header, again.judge
    goal = "reached its goal" if judge.success else "did not reach its goal"
    if judge.success is None:
        goal = "whether it reached its goal is not known"
    if judge.success and judge.success_time is not None:
        goal += f" at {judge.success_time:.2f} s"
    roles = ", ".join(
        f"{role} = {' + '.join(players)}" for role, players in header.roles.items() if players
    )
    facts = [f"“{header.instruction}”" if header.instruction else "", goal, roles]
    return f'<p class="facts">{" · ".join(escape(fact) for fact in facts if fact)}</p>'


def evidence(again: Again, rule: ast.Scoped, verdict: Verdict) -> str:
    """Write a verdict in words, its evidence over time, and its numbers, as HTML."""
    episode = again.episode
    parts = [_sentence(verdict)]
    if isinstance(rule, ast.Rule):
        looked = looks(again, rule, verdict)
        if looked.curves or looked.lanes:
            drawn = timeline(
                np.asarray(episode.t, float), looked, verdict, again.judge.success_time
            )
            parts.append(
                f'<div class="scroll" tabindex="0" role="group" aria-label="timeline">{drawn}</div>'
            )
    parts.append(_numbers(verdict))
    return f'<section class="evidence {verdict.verdict}">{"".join(parts)}</section>'


def looks(again: Again, rule: ast.Rule, verdict: Verdict) -> Looked:
    """The measurements of a rule; costly signals at some frames and at the decisive one."""
    episode = again.episode
    players = dict(again.binding.players(rule, episode.header))
    if not all(players.values()):
        return Looked((), (), ())
    also = [
        int(np.searchsorted(episode.t, time - 1e-6))
        for time in (verdict.time, verdict.worst_time)
        if time is not None
    ]
    evaluator, _ = again.base(rule)
    return looked_at(evaluator, rule, players, verdict, frames_to_measure(len(episode), also))


def _sentence(v: Verdict) -> str:
    name = v.verdict.replace("_", " ")
    severity = f", {v.severity}" if v.severity else ""
    notes = "".join(f'<li class="soft">{escape(note)}</li>' for note in v.notes)
    return (
        f'<h4><span class="verdict {v.verdict}">{name}{escape(severity)}</span> '
        f"<b>{escape(v.rule)}</b> {escape(v.title)}</h4>"
        + (f"<p>{escape(v.explanation)}</p>" if v.explanation else "")
        + (f'<ul class="small">{notes}</ul>' if notes else "")
    )


def _numbers(v: Verdict) -> str:
    facts: list[tuple[str, str]] = []
    if v.signal:
        facts.append(("measured", v.signal))
    if v.value is not None and v.limit is not None and v.dimension:
        value, limit = told_apart(v.value, v.limit, v.dimension)
        facts += [("value", value), ("limit", limit)]
    if v.margin is not None and v.dimension:
        facts.append(("margin", format_quantity(v.margin, v.dimension)))
    if v.time is not None:
        facts.append(("first", f"{v.time:.2f} s"))
    if v.intervals:
        several = "one stretch" if len(v.intervals) == 1 else f"{len(v.intervals)} stretches"
        facts.append(("in violation", f"{v.exposure_time:.2f} s in {several}"))
    if not facts:
        return ""
    items = "".join(f"<div><dt>{escape(a)}</dt><dd>{escape(b)}</dd></div>" for a, b in facts)
    return f'<dl class="numbers">{items}</dl>'


def _key_frame(again: Again, v: Verdict) -> str:
    episode = again.episode
    time = v.worst_time if v.worst_time is not None else v.time
    why = "the worst moment" if v.verdict == "violation" else "the closest call"
    if time is None:
        time, why = again.judge.success_time, "native success"
    if time is None:
        time, why = float(episode.t[-1]), "the end"
    frame = min(int(np.searchsorted(episode.t, time - 1e-6)), len(episode) - 1)
    named = v.bodies or tuple(p for players in episode.header.roles.values() for p in players)
    views = scene(episode, frame, tuple(dict.fromkeys(named)))
    return (
        f'<section class="key-frame"><h4>Key frame: {why}, {episode.t[frame]:.2f} s</h4>'
        f'<div class="views">{views}</div>'
        '<p class="small soft">Drawn from the recorded shapes. Dashed: where a body stood at the '
        "start.</p></section>"
    )


def _differences(verdicts: Sequence[Verdict], said: StoredVerdicts) -> tuple[str, ...]:
    """List where results and the rules used here disagree; always shown."""
    differences = []
    for v in verdicts:
        verdict, digest = said.verdicts.get(v.rule, ("", ""))
        if verdict and verdict != v.verdict:
            differences.append(
                f"The results say {verdict.replace('_', ' ')} of {v.rule}; the rules used for this "
                f"drawing say {v.verdict.replace('_', ' ')}."
            )
        elif digest and digest != v.rule_digest:
            differences.append(f"The results were made under another meaning of {v.rule}.")
    return tuple(differences)


def stored_verdicts(rows: Sequence[Mapping[str, Any]]) -> StoredVerdicts:
    """Read the rows of one episode."""
    return StoredVerdicts(
        {
            str(row["rule"]): (str(row["verdict"]), str(row.get("rule_digest") or ""))
            for row in rows
            if row["assigned"] and row["verdict"] is not None
        },
        tuple(
            (str(row["rule"]), str(row.get("explanation") or ""))
            for row in rows
            if not row["assigned"] and row["verdict"] == "violation"
        ),
    )
