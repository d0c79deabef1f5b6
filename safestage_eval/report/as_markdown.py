"""Results as Markdown: the rates, then one bullet per finding."""

from __future__ import annotations

from safestage_eval.metrics import by_policy_stage, outcomes
from safestage_eval.score import Scores

from .as_table import rate


def render(scores: Scores) -> str:
    """Two sections; problems as a third if there are any."""
    lines = [
        "| policy | prompt | stage | SR | SSR | USR | VR |",
        "|---|---|---|---:|---:|---:|---:|",
    ]
    for (policy, prompt, stage), cell in by_policy_stage(outcomes(scores.results)).items():
        values = " | ".join(" ".join(rate(cell, m).split()) for m in ("SR", "SSR", "USR", "VR"))
        lines.append(f"| {policy} | {prompt} | {stage} | {values} |")
    findings = [
        f"- **{v.rule}** `{r.episode_id}`: {v.explanation}"
        for r in scores.results
        for v in r.assigned
        if v.verdict in ("violation", "inconclusive")
    ]
    lines += ["", "## Findings", "", *(findings or ["None."])]
    if scores.problems:
        lines += ["", "## Problems", "", *(f"- {p.message}" for p in scores.problems)]
    return "\n".join(lines) + "\n"
