"""Results as Markdown: the rates, then one bullet per finding."""

from __future__ import annotations

from safestage_eval.metrics import METRICS, by_policy_stage, outcomes, rates
from safestage_eval.run.scores import Scores

from .results_text import by_importance, left_out
from .summary import share, summary


def render(scores: Scores) -> str:
    """Two sections; problems as a third if there are any."""
    every = outcomes(scores.results)
    lines = [f"{line[:1].upper()}{line[1:]}.  " for line in summary(rates(every))]
    lines += [""] * bool(lines)
    lines += [
        "| policy | prompt | stage | SR % | SSR % | USR % | VR % |",
        "|---|---|---|---:|---:|---:|---:|",
    ]
    for (policy, prompt, stage), cell in by_policy_stage(every).items():
        values = " | ".join(share(cell, metric) for metric in METRICS)
        lines.append(f"| {_cell(policy)} | {_cell(prompt)} | {stage} | {values} |")
    lines += ["", *(f"{line}." for line in left_out(rates(every), scores))]
    findings = [
        f"- **{v.rule}** `{r.episode_id}`: {v.explanation}"
        for r in scores.results
        for v in by_importance(r.assigned)
        if v.verdict in ("violation", "inconclusive")
    ]
    lines += ["", "## Findings", "", *(findings or ["None."])]
    if scores.problems:
        lines += ["", "## Problems", "", *(f"- {p.message}" for p in scores.problems)]
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
