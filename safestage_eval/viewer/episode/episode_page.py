"""The page of one episode; it is complete in itself and loads nothing."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Sequence
from html import escape

from safestage_eval.rules import syntax as ast
from safestage_eval.verdicts import Verdict
from safestage_eval.version import __version__
from safestage_eval.viewer.episode.episode_section import ORDER, evidence
from safestage_eval.viewer.episode.timeline import LEFT, RIGHT, WIDTH
from safestage_eval.viewer.film import film
from safestage_eval.viewer.html_page import THEME_SWITCH, page, part, replay_script
from safestage_eval.whatif.judge_again import Again

Finding = tuple[ast.Scoped, Verdict]

MOST = 12
"""Number of findings whose measurements are drawn over time; further ones are described in words."""


def build(again: Again, *, everything: bool = False) -> str:
    """Build HTML that plays the episode and shows the evidence of its verdicts.

    Args:
        again: the episode under its rules.
        everything: rules that pass without being assigned as well.
    """
    episode, judge = again.episode, again.judge
    header = episode.header
    findings = _findings(again, everything=everything)
    packed_film = base64.b64encode(film(episode)).decode()
    data = {
        "start": float(episode.t[0]),
        "end": float(episode.t[-1]),
        "plot": {"left": LEFT, "right": WIDTH - RIGHT},
        "success": judge.success_time,
        "findings": [
            {"rule": v.rule, "bodies": list(v.bodies), "intervals": [list(i) for i in v.intervals]}
            for _, v in findings
            if v.verdict == "violation"
        ],
    }
    body = [
        '<div class="top"><div class="page"><strong>SafeStage</strong>',
        f'<span class="id" title="episode">{escape(header.episode_id)}</span>{THEME_SWITCH}</div></div>',
        f'<main class="page"><header><h1>{escape(header.task or header.episode_id)}</h1>',
        f'<p class="facts">{_facts(again)}</p></header>',
        '<div class="two"><section class="stage" aria-label="replay">',
        _player(episode.t[-1] - episode.t[0], findings, float(episode.t[0])),
        '</section><section class="findings" aria-label="findings">',
        *_cards(again, findings),
        f"</section></div><footer>SafeStage {__version__}. Times in seconds from the start of the "
        "recording. Replayed from recorded poses and shapes, about fifteen a second; verdicts rest "
        "on every frame.</footer></main>",
        f'<script type="application/json" id="view">{_inert(json.dumps(data))}</script>',
        f'<script type="text/plain" id="film">{packed_film}</script>',
    ]
    sheets = [part("report.css"), part("view.css", __package__)]
    scripts = [replay_script(), part("view.js", __package__)]
    return page(f"{header.episode_id} – SafeStage", body, styles=sheets, scripts=scripts)


def _findings(again: Again, *, everything: bool) -> list[Finding]:
    """Violations first, then what could not be decided, then what passed as assigned."""
    assigned = {rule.code for rule in again.assigned}
    findings = []
    for rule in again.rules.rules.values():
        _, verdict = again.base(rule)
        mine = rule.code in assigned
        if verdict.verdict == "not_applicable" and not (mine or everything):
            continue
        if mine or everything or verdict.verdict == "violation":
            findings.append((rule, verdict))
    place = {code: i for i, code in enumerate(again.rules.rules)}
    return sorted(
        findings,
        key=lambda pair: (
            ORDER.index(pair[1].verdict), pair[0].code not in assigned, place[pair[0].code]
        ),
    )  # fmt: skip


def _facts(again: Again) -> str:
    header, judge = again.episode.header, again.judge
    goal = {True: "reached its goal", False: "did not reach its goal", None: "success not known"}
    said = goal[judge.success]
    if judge.success and judge.success_time is not None:
        said += f" at {judge.success_time:.2f} s"
    labels = [
        f"{name} {value}"
        for name in ("policy", "prompt", "seed", "rollout")
        if (value := getattr(header, name)) is not None
    ]
    quoted = f"“{header.instruction}”" if header.instruction else ""
    return " · ".join(escape(fact) for fact in (quoted, said, ", ".join(labels)) if fact)


def _player(length: float, findings: Sequence[Finding], start: float) -> str:
    """The canvas and what moves it; the strip shows where rules were violated."""
    looks = "".join(
        f'<button type="button" class="quiet" data-look="{name}">{name}</button>'
        for name in ("front", "side", "back", "top")
    )
    speeds = "".join(
        f'<option value="{v}"{" selected" if v == "1" else ""}>{v}×</option>'
        for v in ("0.1", "0.25", "0.5", "1", "2", "4")
    )
    return (
        '<canvas tabindex="0" aria-label="3-D replay. Arrow keys turn the view, plus and minus bring '
        'it nearer and farther, zero resets it."></canvas>'
        '<p class="failed" hidden>This browser draws no 3-D pictures (WebGL 2 is off). The '
        "findings below are complete all the same.</p>"
        f'<div class="strip">{_strip(length, findings, start)}'
        f'<input type="range" min="0" max="{length:.4f}" step="any" value="0" aria-label="time"></div>'
        '<div class="controls"><button type="button" data-play aria-pressed="false">Play</button>'
        '<output class="number" data-clock>0.00 s</output>'
        f'<label>speed <select data-speed>{speeds}</select></label><span class="looks">{looks}</span></div>'
        '<p class="small soft keys"><kbd>space</kbd> play or pause · <kbd>,</kbd> <kbd>.</kbd> a step '
        "back or on · <kbd>v</kbd> next violation · drag to turn, wheel to zoom</p>"
    )


def _strip(length: float, findings: Sequence[Finding], start: float) -> str:
    marks = []
    for _, v in findings:
        if v.verdict != "violation":
            continue
        for a, b in v.intervals:
            x, width = 1000 * (a - start) / length, max(1000 * (b - a) / length, 2.0)
            marks.append(
                f'<rect x="{x:.1f}" y="0" width="{width:.1f}" height="10"><title>{escape(v.rule)} in '
                f"violation from {a:.2f} s to {b:.2f} s</title></rect>"
            )
    return f'<svg viewBox="0 0 1000 10" preserveAspectRatio="none" aria-hidden="true">{"".join(marks)}</svg>'


def _cards(again: Again, findings: Sequence[Finding]) -> Iterable[str]:
    if not findings:
        yield (
            '<p class="note">None of the rules applies: the trace has no assigned rules among those '
            "loaded, or no roles. <code>--bind</code> and <code>--rules</code> supply them.</p>"
        )
    for i, (rule, v) in enumerate(findings):
        moments = [("first", v.time), ("worst", v.worst_time)]
        if v.verdict == "pass":
            moments = [("closest", v.worst_time)]
        buttons = "".join(
            f'<button type="button" data-seek="{time:.4f}">{name} {time:.2f} s</button>'
            for name, time in moments
            if time is not None
        )
        status = "assigned to this task"
        if not v.assigned:
            status = f"follows {v.consequence_of}" if v.consequence_of else "not assigned"
        text = evidence(again, rule, v) if i < MOST else f"<p>{escape(v.explanation)}</p>"
        yield (
            f'<article class="card" id="{escape(v.rule)}"><p class="moments">{buttons}'
            f'<span class="small soft">{escape(status)}</span></p>{text}</article>'
        )


def _inert(text: str) -> str:
    """Escape JSON so that it cannot end the element it stands in."""
    return text.replace("<", "\\u003c")
